//! Proposals to people, and the people's decisions.

use fleetcal_model::{ProposalId, Version};
use fleetcal_proto::calibration::CalibrationValues;

use super::draft::{Draft, after, fresh};
use super::policy::Policy;
use super::present::{Present, outdated};
use super::proposal::{Approval, Closing, Proposal, ProposalEvent, ProposalState, Refreshed};
use super::refused::Refused;
use super::revision::{Evidence, Origin};
use super::second_approver::approvals_needed;
use super::transition::ProposalAction;
use super::values::added;
use crate::access::Authentication;

/// Farthest distance of a LiDAR from the rear axle that is believed, m.
const BELIEVED_DISTANCE_MAX_M: f64 = 30.0;

impl Draft<'_> {
    pub(super) fn propose(
        &mut self,
        origin: Origin,
        (values, sigmas): (CalibrationValues, CalibrationValues),
        evidence: Evidence,
        reason: Option<String>,
    ) -> Result<(), Refused> {
        within_limits(&values, self.standing.policy)?;
        match self.standing.present {
            Present::Reassembled => return Err(Refused::ReassemblyOpen),
            Present::TwoSenders if origin == Origin::Estimator => return Err(Refused::TwoSenders),
            _ => {}
        }
        self.nothing_underway()?;
        if let Some(open) = &self.outcome.ledger.open {
            let id = open.id;
            let newer = "a newer proposal was made".to_owned();
            self.close(id, None, ProposalEvent::Supersede, Some(newer))?;
        }
        let rear_axle = self.standing.rear_axle_in_base_link;
        let revision = self.add_revision(origin, (values, sigmas), evidence, rear_axle);
        let shadow = &self.outcome.ledger.shadow;
        let by = self.standing.actor.name.clone();
        let second_approver = self.second_approver(&revision, &[&by]);
        let now = self.standing.now;
        let proposal = Proposal {
            id: self.ids.proposal,
            robot: shadow.robot.clone(),
            version: Version(1),
            state: ProposalState::Proposed,
            revision: revision.id,
            revision_sha256: revision.sha256,
            proposed_by: by,
            reason: reason.clone(),
            created_ns: now,
            expires_ns: after(now, self.standing.policy.expires_after_s),
            base: self.base(),
            base_generation: shadow.in_use.as_ref().map(|in_use| in_use.generation),
            drawn_by: self.drawn_by(),
            approvals_needed: approvals_needed(second_approver),
            second_approver,
            approvals: Vec::new(),
            closing: None,
            refreshed: None,
        };
        self.ids.proposal = self.ids.proposal.next();
        self.save_proposal(ProposalAction::Create, None, proposal, reason);
        Ok(())
    }

    /// Replaces the proposed values by the present estimate.
    pub(super) fn refresh(
        &mut self,
        id: ProposalId,
        found: (CalibrationValues, CalibrationValues),
        evidence: Evidence,
        reason: &str,
    ) -> Result<(), Refused> {
        within_limits(&found.0, self.standing.policy)?;
        let before = self.open_proposal(id, None)?;
        let rear_axle = self.standing.rear_axle_in_base_link;
        let revision = self.add_revision(Origin::Estimator, found, evidence, rear_axle);
        let in_use = self.outcome.ledger.shadow.in_use.as_ref();
        let base_generation = in_use.map(|in_use| in_use.generation);
        let now = self.standing.now;
        let voided: Vec<String> = before.approvals.iter().map(|one| one.by.clone()).collect();
        let void = match voided.as_slice() {
            [] => String::new(),
            names => format!("; void is the approval of {}", names.join(", ")),
        };
        let times = before.refreshed.as_ref().map_or(0, |last| last.times);
        let second_approver = self.second_approver(&revision, &[&before.proposed_by]);
        let proposal = Proposal {
            version: before.version.next(),
            state: before.state.after(ProposalEvent::Refresh)?,
            approvals_needed: approvals_needed(second_approver),
            second_approver,
            revision: revision.id,
            revision_sha256: revision.sha256,
            base: self.base(),
            base_generation,
            drawn_by: self.drawn_by(),
            approvals: Vec::new(),
            expires_ns: after(now, self.standing.policy.expires_after_s),
            refreshed: Some(Refreshed {
                at_ns: now,
                times: times.saturating_add(1),
                reason: reason.to_owned(),
                voided,
            }),
            ..before.clone()
        };
        let reason = Some(format!("{reason}{void}"));
        self.save_proposal(ProposalAction::Refresh, Some(&before), proposal, reason);
        Ok(())
    }

    /// Values in use as the robot reported them, or else its drawing's.
    fn base(&self) -> Option<CalibrationValues> {
        let in_use = self.outcome.ledger.shadow.in_use.as_ref();
        let drawing = self.standing.drawing.as_ref();
        let drawn = || drawing.map(|drawing| drawing.values);
        in_use.map(|in_use| in_use.values).or_else(drawn)
    }

    /// Refuses to approve a proposal that the present estimate contradicts.
    fn still_holds(&self, proposal: &Proposal) -> Result<(), Refused> {
        let proposed = self.outcome.ledger.revisions.get(&proposal.revision);
        match proposed.and_then(|one| outdated(one, &self.standing.present)) {
            Some(outdated) => Err(Refused::Outdated(outdated)),
            None => Ok(()),
        }
    }

    pub(super) fn approve(
        &mut self,
        id: ProposalId,
        version: Option<Version>,
        sha256: String,
        reason: Option<String>,
    ) -> Result<(), Refused> {
        let before = self.open_proposal(id, version)?;
        let actor = self.standing.actor;
        if self.standing.now >= before.expires_ns {
            let state = ProposalState::Expired;
            return Err(Refused::ProposalClosed { state });
        }
        if before.revision_sha256 != sha256 {
            return Err(Refused::OtherRevision {
                given: sha256,
                found: before.revision_sha256,
            });
        }
        let by_service = actor.authentication == Authentication::Service;
        if before.proposed_by == actor.name && !by_service {
            return Err(Refused::OwnProposal(actor.name.clone()));
        }
        if before.approvals.iter().any(|one| one.by == actor.name) {
            return Err(Refused::ApprovedAlready(actor.name.clone()));
        }
        if by_service {
            self.nobody_chose()?;
            self.nothing_contradicts()?;
        }
        self.nothing_underway()?;
        self.still_holds(&before)?;
        let mut proposal = before.clone();
        proposal.second_approver = self.second_approver_now(&before, &actor.name);
        let needed = approvals_needed(proposal.second_approver);
        proposal.approvals_needed = before.approvals_needed.max(needed);
        proposal.approvals.push(Approval {
            by: actor.name.clone(),
            at_ns: self.standing.now,
            sha256,
            reason: reason.clone(),
        });
        let enough = proposal.approvals.len() >= proposal.approvals_needed as usize;
        let event = if enough {
            ProposalEvent::Approve
        } else {
            ProposalEvent::ApproveInPart
        };
        proposal.state = before.state.after(event)?;
        proposal.version = proposal.version.next();
        self.save_proposal(event.into(), Some(&before), proposal.clone(), reason);
        if enough {
            self.count_step(&proposal, by_service);
            self.deploy(Some(&proposal), proposal.revision, proposal.base, None)?;
        }
        Ok(())
    }

    /// Adds a step that the service approved to the sum of such steps; a person's approval resets
    /// the sum. The deployment records the desired calibration.
    fn count_step(&mut self, proposal: &Proposal, by_service: bool) {
        let ledger = &self.outcome.ledger;
        self.automatic_sum = Some(match ledger.step_of(proposal) {
            Some(step) if by_service => added(&ledger.shadow.automatic_sum, &step),
            _ => [0.0; 4],
        });
    }

    /// Closes a proposal other than by approval.
    pub(super) fn close(
        &mut self,
        id: ProposalId,
        version: Option<Version>,
        event: ProposalEvent,
        reason: Option<String>,
    ) -> Result<(), Refused> {
        let before = self.open_proposal(id, version)?;
        let mut proposal = before.clone();
        proposal.state = before.state.after(event)?;
        proposal.version = proposal.version.next();
        proposal.closing = Some(Closing {
            by: self.standing.actor.name.clone(),
            at_ns: self.standing.now,
            reason: reason.clone(),
        });
        if matches!(event, ProposalEvent::Reject | ProposalEvent::Withdraw) {
            self.decline(before.revision);
        }
        self.save_proposal(event.into(), Some(&before), proposal, reason);
        Ok(())
    }

    fn open_proposal(&self, id: ProposalId, version: Option<Version>) -> Result<Proposal, Refused> {
        let open = self.outcome.ledger.open.as_ref();
        let open = open
            .filter(|open| open.id == id)
            .ok_or(Refused::NotOpen(id))?;
        fresh(version, open.version)?;
        Ok(open.clone())
    }

    /// Refuses the service's own replacement of a calibration that a person rolled the robot back
    /// to.
    fn nobody_chose(&self) -> Result<(), Refused> {
        let desired = self.outcome.ledger.shadow.desired.as_ref();
        match desired.and_then(|one| Some((one.generation, one.chosen_by.clone()?))) {
            Some((generation, by)) => Err(Refused::ChosenByPerson { generation, by }),
            None => Ok(()),
        }
    }

    /// Refuses the service's own approval while an answer in the robot's name contradicts another.
    fn nothing_contradicts(&self) -> Result<(), Refused> {
        match &self.outcome.ledger.shadow.contradicted {
            Some(one) => Err(Refused::AnswersContradict {
                said: one.generation,
                generation: one.by_generation,
            }),
            None => Ok(()),
        }
    }

    fn nothing_underway(&self) -> Result<(), Refused> {
        match &self.outcome.ledger.live {
            Some(live) => Err(Refused::Underway {
                deployment: live.id,
                state: live.state,
            }),
            None => Ok(()),
        }
    }
}

/// Refuses to propose values beyond the policy's limits.
pub(super) fn within_limits(values: &CalibrationValues, policy: &Policy) -> Result<(), Refused> {
    let steering_rad = policy.steering_offset_max_deg.to_radians();
    within_bounds(values, steering_rad, policy.lidar_distance_max_m)
}

/// Refuses values that no vehicle can have, whatever the policy was at their approval.
pub(super) fn believable(values: &CalibrationValues) -> Result<(), Refused> {
    within_bounds(values, std::f64::consts::FRAC_PI_2, BELIEVED_DISTANCE_MAX_M)
}

fn within_bounds(
    values: &CalibrationValues,
    steering_rad: f64,
    distance_m: f64,
) -> Result<(), Refused> {
    let checks = [
        (
            "steering_offset_rad",
            values.steering_offset_rad,
            steering_rad,
        ),
        ("lidar_x_m", values.lidar_x_m, distance_m),
        ("lidar_y_m", values.lidar_y_m, distance_m),
        ("lidar_yaw_rad", values.lidar_yaw_rad, std::f64::consts::TAU),
    ];
    for (field, value, most) in checks {
        if !(-most..=most).contains(&value) {
            let accepted = format!("{:.4} to {most:.4}", -most);
            return Err(Refused::OutOfLimits {
                field,
                value,
                accepted,
            });
        }
    }
    // What an agent accepts unless its robot says otherwise.
    let others = [
        ("speed_scale", values.speed_scale, 0.8..=1.25),
        ("wheelbase_m", values.wheelbase_m, 0.1..=10.0),
        ("steering_gain", values.steering_gain, 0.5..=2.0),
        ("time_offset_s", values.time_offset_s, -0.5..=0.5),
    ];
    for (field, value, accepted) in others {
        if let Some(value) = value.filter(|value| !accepted.contains(value)) {
            return Err(Refused::OutOfLimits {
                field,
                value,
                accepted: format!("{} to {}", accepted.start(), accepted.end()),
            });
        }
    }
    Ok(())
}
