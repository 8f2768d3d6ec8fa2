//! Deployment of values to the robot: of approved ones, and of former ones in a roll-back.

use fleetcal_model::{Generation, Pose2, RevisionId, RobotTime, Version};
use fleetcal_proto::calibration::{
    CalibrationDocument, CalibrationFrame, CalibrationSchema, CalibrationValues,
};
use fleetcal_proto::signing::seal;

use super::deployment::{Deployment, DeploymentEvent, DeploymentState, RollBack};
use super::draft::{Draft, after};
use super::generation::{GenerationRef, InUse};
use super::ledger::OutboxEntry;
use super::proposal::Proposal;
use super::refused::Refused;
use super::revision::{Evidence, Origin};
use super::transition::{DeploymentAction, ShadowAction};
use crate::timestamp;

/// Originator of a roll-back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rollback {
    /// A person: only a person undoes it.
    ByPerson,
    /// The service, after a failed verification or a newer estimate.
    Automatic,
}

/// Pose of `pose`, given in `frame`, in the frame that `frame` is given in.
fn within(frame: Pose2, pose: &Pose2) -> Pose2 {
    frame.compose(pose)
}

impl Draft<'_> {
    /// Queues a revision for the robot: an approved proposal's, or an earlier one.
    pub(super) fn deploy(
        &mut self,
        proposal: Option<&Proposal>,
        revision: RevisionId,
        nominal: Option<CalibrationValues>,
        reason: Option<String>,
    ) -> Result<(), Refused> {
        let shadow = &self.outcome.ledger.shadow;
        let factory = |values| InUse {
            generation: Generation::FACTORY,
            revision: None,
            values,
            since_ns: RobotTime::default(),
        };
        let base = shadow.in_use.clone().or(nominal.map(factory));
        let base_generation = base.as_ref().map(|base| base.generation);
        let desired_before = shadow.desired.clone();
        let approved_by = self.approvers(proposal);
        let chosen_by = proposal.is_none().then(|| approved_by.clone());
        let roll_back = match &reason {
            Some(reason) if proposal.is_none() => {
                self.note_roll_back(Rollback::ByPerson, revision, reason)
            }
            _ => None,
        };
        let offer = self.sign(revision, base_generation, &approved_by, chosen_by)?;
        let now = self.standing.now;
        let deployment = Deployment {
            id: self.ids.deployment,
            robot: self.outcome.ledger.shadow.robot.clone(),
            version: Version(1),
            state: DeploymentState::Queued,
            proposal: proposal.map(|proposal| proposal.id),
            approved_by,
            offer,
            earlier: Vec::new(),
            base,
            desired_before,
            created_ns: now,
            expires_ns: after(now, self.standing.policy.expires_after_s),
            offered_ns: None,
            applied_ns: None,
            closed_ns: None,
            verification: None,
            reason: reason.clone(),
            roll_back,
        };
        self.ids.deployment = self.ids.deployment.next();
        self.save_deployment(DeploymentAction::Create, None, deployment, reason);
        Ok(())
    }

    /// Record of a roll-back to a revision.
    fn note_roll_back(
        &self,
        rollback: Rollback,
        revision: RevisionId,
        reason: &str,
    ) -> Option<RollBack> {
        let revision = self.outcome.ledger.revisions.get(&revision)?;
        Some(RollBack {
            by: self.standing.actor.name.clone(),
            automatic: rollback == Rollback::Automatic,
            at_ns: self.standing.now,
            reason: reason.to_owned(),
            values: revision.values,
        })
    }

    fn approvers(&self, proposal: Option<&Proposal>) -> String {
        let names = proposal.map(|proposal| {
            let names: Vec<&str> = proposal
                .approvals
                .iter()
                .map(|one| one.by.as_str())
                .collect();
            names.join(", ")
        });
        names.unwrap_or_else(|| self.standing.actor.name.clone())
    }

    /// Signs a revision under the next generation and makes it the desired calibration.
    fn sign(
        &mut self,
        revision: RevisionId,
        base_generation: Option<Generation>,
        approved_by: &str,
        chosen_by: Option<String>,
    ) -> Result<GenerationRef, Refused> {
        let named = self.outcome.ledger.revisions.get(&revision);
        let named = named.ok_or(Refused::NothingToReturnTo)?;
        let mut shadow = self.outcome.ledger.shadow.clone();
        shadow.generation_last = shadow.generation_last.next();
        let generation = shadow.generation_last;
        let rear_axle = named.rear_axle_in_base_link;
        let CalibrationValues {
            lidar_x_m,
            lidar_y_m,
            lidar_yaw_rad,
            ..
        } = named.values;
        let lidar = Pose2::new(lidar_x_m, lidar_y_m, lidar_yaw_rad);
        let document = CalibrationDocument {
            schema: CalibrationSchema::V1,
            robot: shadow.robot.clone(),
            generation,
            base_generation,
            revision,
            approved_at: timestamp::of(self.standing.now).to_string(),
            approved_by: approved_by.to_owned(),
            values: named.values,
            sigmas: named.sigmas,
            covariance: named.evidence.covariance,
            steering_table: named.evidence.steering_table.clone(),
            frame: CalibrationFrame::RearAxle,
            confirm_within_s: self.standing.policy.confirm_within_s,
            rear_axle_in_base_link: rear_axle,
            lidar_in_base_link: rear_axle.map(|axle| within(axle, &lidar)),
        };
        let envelope =
            seal(&document, self.standing.key).map_err(|error| Refused::Seal(error.to_string()))?;
        let offer = GenerationRef {
            generation,
            sha256: envelope.sha256.clone(),
            revision,
            chosen_by,
        };
        shadow.desired = Some(offer.clone());
        self.save_shadow(ShadowAction::Desire, shadow, None);
        self.outcome.envelopes.push((generation, envelope));
        self.outcome.outbox.push(OutboxEntry::Approved(generation));
        Ok(offer)
    }

    /// Rolls back to the former values in any state of the deployment; without one under way, to
    /// the verified ones before those in use.
    pub(super) fn roll_back(&mut self, rollback: Rollback, reason: String) -> Result<(), Refused> {
        let Some(before) = self.outcome.ledger.live.clone() else {
            return self.return_to_verified(reason);
        };
        let base = match (before.state, before.base.clone()) {
            (DeploymentState::Queued, _) | (DeploymentState::Offered, None) => {
                return self.withdraw(&before, rollback, reason);
            }
            (_, base) => base.ok_or(Refused::NothingToReturnTo)?,
        };
        let state = before.state.after(DeploymentEvent::RollBack)?;
        let approved = before.earlier.first().unwrap_or(&before.offer).revision;
        self.decline(approved);
        let revision = self.revision_of(&base, Some(approved));
        let by = self.standing.actor.name.clone();
        let chosen_by = match rollback {
            Rollback::ByPerson => Some(by.clone()),
            // What a person had chosen before stays that person's choice.
            Rollback::Automatic => before
                .desired_before
                .as_ref()
                .filter(|one| one.generation == base.generation)
                .and_then(|one| one.chosen_by.clone()),
        };
        let offer = self.sign(revision, Some(before.offer.generation), &by, chosen_by)?;
        let mut live = before.clone();
        live.roll_back = self.note_roll_back(rollback, revision, &reason);
        live.earlier.push(std::mem::replace(&mut live.offer, offer));
        live.expires_ns = after(self.standing.now, self.standing.policy.expires_after_s);
        live.state = state;
        self.advance(
            &before,
            live,
            DeploymentEvent::RollBack,
            DeploymentAction::RollBack,
            Some(reason),
        )
    }

    /// Withdraws a deployment that was not offered yet, or that has no former values to return to:
    /// the robot keeps the values in use. A robot that has applied it meanwhile reverts by itself,
    /// for lack of a confirmation.
    fn withdraw(
        &mut self,
        before: &Deployment,
        rollback: Rollback,
        reason: String,
    ) -> Result<(), Refused> {
        let mut live = before.clone();
        live.roll_back = before.base.as_ref().map(|base| RollBack {
            by: self.standing.actor.name.clone(),
            automatic: rollback == Rollback::Automatic,
            at_ns: self.standing.now,
            reason: reason.clone(),
            values: base.values,
        });
        let (event, action) = (DeploymentEvent::Withdraw, DeploymentAction::RollBack);
        self.advance(before, live, event, action, Some(reason))
    }

    /// Revision of the values in use before, which may be the factory calibration; its frames are
    /// those of the revision that the robot returns from.
    fn revision_of(&mut self, base: &InUse, from: Option<RevisionId>) -> RevisionId {
        let known = base
            .revision
            .filter(|id| self.outcome.ledger.revisions.contains_key(id));
        known.unwrap_or_else(|| {
            let values = (base.values, CalibrationValues::default());
            let revisions = &self.outcome.ledger.revisions;
            let from = from.and_then(|from| revisions.get(&from));
            let rear_axle = from.and_then(|from| from.rear_axle_in_base_link);
            self.add_revision(Origin::Robot, values, Evidence::default(), rear_axle)
                .id
        })
    }

    /// Removes a revision that was rolled back from the verified ones, so that no return leads to
    /// it.
    fn forget_proof(&mut self, revision: RevisionId) {
        let mut shadow = self.outcome.ledger.shadow.clone();
        shadow.verified.retain(|one| one.revision != revision);
        if shadow.verified.len() < self.outcome.ledger.shadow.verified.len() {
            self.save_shadow(ShadowAction::Forget, shadow, None);
        }
    }

    fn return_to_verified(&mut self, reason: String) -> Result<(), Refused> {
        let shadow = &self.outcome.ledger.shadow;
        let in_use = shadow.in_use.as_ref().ok_or(Refused::NothingToReturnTo)?;
        let used = in_use.revision;
        let earlier = shadow.verified.iter().rev();
        let verified = earlier.map(|one| one.revision).find(|id| Some(*id) != used);
        let declined = shadow.declined;
        let before = shadow.before.clone();
        let before = before.filter(|one| one.revision.is_none() || one.revision != declined);
        let revision = match (verified, before) {
            (Some(revision), _) => revision,
            (None, Some(before)) => self.revision_of(&before, used),
            (None, None) => return Err(Refused::NothingEarlier),
        };
        if let Some(used) = used {
            self.decline(used);
            self.forget_proof(used);
        }
        self.deploy(None, revision, None, Some(reason))
    }
}
