//! Takes a command: the records anew, or a refusal.

use fleetcal_proto::calibration::{Applied, AppliedStatus, CalibrationValues};
use serde::Serialize;
use serde_json::Value;

use super::command::{Command, Refused, Standing};
use super::deployment::{
    Deployment, DeploymentEvent, DeploymentState, GenerationRef, Verification,
};
use super::ledger::{NextIds, Outcome, Parcel, RobotLedger, Subject, Transition};
use super::policy::Policy;
use super::proposal::{Approval, Closing, Proposal, ProposalEvent, ProposalState};
use super::revision::{Evidence, Origin, Revision};
use super::shadow::{InUse, Reported, Shadow};
use super::values::{difference, exceeds};
use crate::access::Authentication;

/// Nanoseconds in a second.
const NS_PER_S: i64 = 1_000_000_000;

/// Takes a command on a robot's records.
///
/// # Errors
/// When it does not fit them; nothing has changed then.
pub fn step(
    ledger: &RobotLedger,
    command: Command,
    ids: NextIds,
    standing: &Standing<'_>,
) -> Result<Outcome, Refused> {
    let mut draft = Draft::new(ledger, ids, standing);
    match command {
        Command::Propose {
            origin,
            values,
            sigmas,
            evidence,
            nominal,
            reason,
        } => draft.propose(origin, (values, sigmas), evidence, nominal, reason)?,
        Command::Approve {
            proposal,
            version,
            sha256,
            reason,
        } => draft.approve(proposal, version, sha256, reason)?,
        Command::Reject {
            proposal,
            version,
            reason,
        } => {
            let reason = said(reason)?;
            draft.close(proposal, version, ProposalEvent::Reject, Some(reason))?;
        }
        Command::Withdraw {
            proposal,
            version,
            reason,
        } => draft.close(proposal, version, ProposalEvent::Withdraw, reason)?,
        Command::Expire { proposal } => {
            draft.close(proposal, None, ProposalEvent::Expire, None)?;
        }
        Command::Supersede { proposal, reason } => {
            draft.close(proposal, None, ProposalEvent::Supersede, Some(reason))?;
        }
        Command::Offer { generation } => draft.offer(generation)?,
        Command::Offered { generation } => {
            draft.offered(generation);
        }
        Command::Acknowledge(applied) => draft.acknowledge(applied)?,
        Command::Confirmed { generation } => draft.confirmed(generation)?,
        Command::Judge {
            deployment,
            verification,
        } => draft.judge(deployment, verification)?,
        Command::GiveUp { deployment, reason } => draft.give_up(deployment, reason)?,
        Command::Void { deployment, reason } => draft.void(deployment, reason)?,
        Command::RollBack { version, reason } => {
            let found = draft.outcome.ledger.shadow.version;
            fresh(version, found)?;
            draft.roll_back(said(reason)?)?;
        }
    }
    draft.outcome.ledger.answered = None;
    Ok(draft.outcome)
}

/// What a step has made so far.
pub(super) struct Draft<'a> {
    pub(super) standing: &'a Standing<'a>,
    pub(super) ids: NextIds,
    pub(super) outcome: Outcome,
}

impl<'a> Draft<'a> {
    fn new(ledger: &RobotLedger, ids: NextIds, standing: &'a Standing<'a>) -> Self {
        Self {
            standing,
            ids,
            outcome: Outcome {
                ledger: ledger.clone(),
                revisions: Vec::new(),
                proposals: Vec::new(),
                deployments: Vec::new(),
                shadow_changed: false,
                envelopes: Vec::new(),
                parcels: Vec::new(),
                sent: None,
                transitions: Vec::new(),
            },
        }
    }

    fn propose(
        &mut self,
        origin: Origin,
        (values, sigmas): (CalibrationValues, CalibrationValues),
        evidence: Evidence,
        nominal: Option<CalibrationValues>,
        reason: Option<String>,
    ) -> Result<(), Refused> {
        within_limits(&values, self.standing.policy)?;
        self.nothing_underway()?;
        if let Some(open) = &self.outcome.ledger.open {
            let id = open.id;
            let newer = "a newer proposal was made".to_owned();
            self.close(id, None, ProposalEvent::Supersede, Some(newer))?;
        }
        let revision = self.add_revision(origin, (values, sigmas), evidence);
        let shadow = &self.outcome.ledger.shadow;
        let base = shadow
            .in_use
            .as_ref()
            .map(|in_use| in_use.values)
            .or(nominal);
        let approvals_needed = self.approvers_needed(base.as_ref(), &values);
        let now_ns = self.standing.now_ns;
        let proposal = Proposal {
            id: self.ids.proposal,
            robot: shadow.robot.clone(),
            version: 1,
            state: ProposalState::Proposed,
            revision: revision.id,
            revision_sha256: revision.sha256,
            proposed_by: self.standing.actor.name.clone(),
            reason: reason.clone(),
            created_ns: now_ns,
            expires_ns: after(now_ns, self.standing.policy.expires_after_s),
            base,
            base_generation: shadow.in_use.as_ref().map(|in_use| in_use.generation),
            approvals_needed,
            approvals: Vec::new(),
            closing: None,
        };
        self.ids.proposal += 1;
        self.save_proposal("proposal.create", None, proposal, reason);
        Ok(())
    }

    fn approve(
        &mut self,
        id: u64,
        version: Option<u64>,
        sha256: String,
        reason: Option<String>,
    ) -> Result<(), Refused> {
        let before = self.open_proposal(id, version)?;
        let actor = self.standing.actor;
        if self.standing.now_ns >= before.expires_ns {
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
        self.nothing_underway()?;
        let mut proposal = before.clone();
        proposal.approvals_needed = self.approvers_needed_now(&before);
        proposal.approvals.push(Approval {
            by: actor.name.clone(),
            at_ns: self.standing.now_ns,
            sha256,
            reason: reason.clone(),
        });
        let enough = proposal.approvals.len() >= proposal.approvals_needed as usize;
        let (event, action) = if enough {
            (ProposalEvent::Approve, "proposal.approve")
        } else {
            (ProposalEvent::ApproveInPart, "proposal.approve_in_part")
        };
        proposal.state = before.state.after(event)?;
        proposal.version += 1;
        self.save_proposal(action, Some(&before), proposal.clone(), reason);
        if enough {
            self.deploy(Some(&proposal), proposal.revision, proposal.base, None)?;
        }
        Ok(())
    }

    /// How many people have to agree to a change.
    fn approvers_needed(&self, base: Option<&CalibrationValues>, to: &CalibrationValues) -> u32 {
        let limits = self.standing.policy.two_approvers_beyond.limits();
        let large = base.is_some_and(|base| exceeds(&difference(base, to), &limits));
        if large { 2 } else { 1 }
    }

    /// How many have to agree to a proposal now: the robot may use something else by now than
    /// when it was made, so that the change is a larger one.
    fn approvers_needed_now(&self, proposal: &Proposal) -> u32 {
        let ledger = &self.outcome.ledger;
        let base = ledger.shadow.in_use.as_ref().map(|in_use| in_use.values);
        let proposed = ledger.revisions.get(&proposal.revision);
        let now = proposed.map_or(1, |to| self.approvers_needed(base.as_ref(), &to.values));
        proposal.approvals_needed.max(now)
    }

    /// Ends a proposal otherwise than by approval.
    fn close(
        &mut self,
        id: u64,
        version: Option<u64>,
        event: ProposalEvent,
        reason: Option<String>,
    ) -> Result<(), Refused> {
        let before = self.open_proposal(id, version)?;
        let mut proposal = before.clone();
        proposal.state = before.state.after(event)?;
        proposal.version += 1;
        proposal.closing = Some(Closing {
            by: self.standing.actor.name.clone(),
            at_ns: self.standing.now_ns,
            reason: reason.clone(),
        });
        let action = match event {
            ProposalEvent::Reject => "proposal.reject",
            ProposalEvent::Withdraw => "proposal.withdraw",
            ProposalEvent::Expire => "proposal.expire",
            _ => "proposal.supersede",
        };
        if matches!(event, ProposalEvent::Reject | ProposalEvent::Withdraw) {
            self.decline(before.revision);
        }
        self.save_proposal(action, Some(&before), proposal, reason);
        Ok(())
    }

    fn open_proposal(&self, id: u64, version: Option<u64>) -> Result<Proposal, Refused> {
        let open = self.outcome.ledger.open.as_ref();
        let open = open
            .filter(|open| open.id == id)
            .ok_or(Refused::NotOpen(id))?;
        fresh(version, open.version)?;
        Ok(open.clone())
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

    /// The robot is about to see the document.
    fn offer(&mut self, generation: u64) -> Result<(), Refused> {
        let Some(before) = self.live_offer(generation) else {
            return Ok(());
        };
        if before.state == DeploymentState::Queued {
            let mut live = before.clone();
            live.offered_ns = Some(self.standing.now_ns);
            self.advance(
                &before,
                live,
                DeploymentEvent::Offer,
                "deployment.offer",
                None,
            )?;
        }
        Ok(())
    }

    /// The robot was shown the document. One that nobody was to see yet still has to be sent.
    fn offered(&mut self, generation: u64) {
        let live = self.live_offer(generation);
        if live.is_none_or(|live| live.state != DeploymentState::Queued) {
            self.outcome.sent = Some(Parcel::Approved(generation));
        }
    }

    /// The robot was told that its answer is stored.
    fn confirmed(&mut self, generation: u64) -> Result<(), Refused> {
        self.outcome.sent = Some(Parcel::Confirmed(generation));
        let Some(before) = self.live_offer(generation) else {
            return Ok(());
        };
        if before.state == DeploymentState::Applied {
            let event = DeploymentEvent::Confirmed;
            self.advance(&before, before.clone(), event, "deployment.confirm", None)?;
        }
        Ok(())
    }

    fn live_offer(&self, generation: u64) -> Option<Deployment> {
        let live = self.outcome.ledger.live.as_ref();
        live.filter(|live| live.offer.generation == generation)
            .cloned()
    }

    fn acknowledge(&mut self, applied: Applied) -> Result<(), Refused> {
        let last = self.outcome.ledger.shadow.generation_last;
        if applied.generation > last {
            return Err(Refused::NeverOffered {
                generation: applied.generation,
                last,
            });
        }
        if let Some(live) = self.live_offer(applied.generation) {
            same_document(&live.offer, &applied)?;
            return self.answer_to_offer(&live, applied);
        }
        let ledger = &self.outcome.ledger;
        let named = ledger.reference(applied.generation).cloned();
        if let Some(named) = &named {
            same_document(named, &applied)?;
        }
        let desired = ledger.shadow.desired.as_ref();
        let is_desired = desired.is_some_and(|one| one.generation == applied.generation);
        // That an older one was refused, or dropped, is no news of a robot that uses a newer one.
        let uses_newer = |in_use: &InUse| in_use.generation > applied.generation;
        let is_old = ledger.shadow.in_use.as_ref().is_some_and(uses_newer);
        if is_old && !is_desired && applied.status != AppliedStatus::Applied {
            return Ok(());
        }
        // A robot that uses what is not wanted any more is not told to keep it: it goes back.
        let unwanted =
            applied.status == AppliedStatus::Applied && applied.generation > 0 && !is_desired;
        self.report(&applied, named.map(|one| one.revision), !unwanted);
        Ok(())
    }

    /// The robot answers what it is offered now.
    fn answer_to_offer(&mut self, before: &Deployment, applied: Applied) -> Result<(), Refused> {
        use DeploymentState as S;
        let (event, action) = match applied.status {
            AppliedStatus::Applied => (DeploymentEvent::Applied, "deployment.apply"),
            AppliedStatus::Refused => (DeploymentEvent::Refused, "deployment.refuse"),
            AppliedStatus::Failed => (DeploymentEvent::Failed, "deployment.fail"),
            AppliedStatus::Reverted => (DeploymentEvent::Reverted, "deployment.revert"),
        };
        let again =
            event == DeploymentEvent::Applied && matches!(before.state, S::Applied | S::Verifying);
        if !again {
            let mut live = before.clone();
            live.applied_ns = Some(self.standing.now_ns);
            let reason = applied.reason.clone();
            self.advance(before, live, event, action, reason)?;
        }
        self.report(&applied, Some(before.offer.revision), true);
        Ok(())
    }

    /// Writes down what a robot said, and what it therefore uses.
    fn report(&mut self, applied: &Applied, revision: Option<u64>, confirm: bool) {
        let generation = applied.generation;
        let now_ns = self.standing.now_ns;
        let mut shadow = self.outcome.ledger.shadow.clone();
        match applied.status {
            AppliedStatus::Applied => self.now_uses(&mut shadow, applied, revision),
            // It may have gone back from what it never told us that it used.
            AppliedStatus::Reverted if shadow.uses(generation) => {
                let before = shadow.before.take();
                let values = applied
                    .values
                    .or(before.as_ref().map(|before| before.values));
                shadow.in_use = values.map(|values| InUse {
                    generation: before.as_ref().map_or(0, |before| before.generation),
                    revision: before.and_then(|before| before.revision),
                    values,
                    since_ns: applied.applied_at_ns,
                });
            }
            AppliedStatus::Reverted | AppliedStatus::Refused | AppliedStatus::Failed => {}
        }
        let reported = Reported {
            generation,
            sha256: applied.sha256.clone(),
            status: applied.status,
            reason: applied.reason.clone(),
            at_ns: applied.applied_at_ns,
            received_ns: now_ns,
            confirmed: confirm,
        };
        let is_news = shadow.reported.as_ref().is_none_or(|last| {
            let received_ns = last.received_ns;
            *last
                != Reported {
                    received_ns,
                    ..reported.clone()
                }
        }) || shadow.in_use != self.outcome.ledger.shadow.in_use;
        // One confirmation waits at a time, and that of what is under way goes first.
        let live = self.outcome.ledger.live.as_ref();
        let another_waits = live.is_some_and(|live| {
            live.state == DeploymentState::Applied && live.offer.generation != generation
        });
        if confirm && generation > 0 && !another_waits {
            self.outcome.parcels.push(Parcel::Confirmed(generation));
        }
        // The same answer again, because its confirmation was lost, is no news.
        if is_news {
            shadow.reported = Some(reported);
            self.save_shadow("shadow.report", shadow, applied.reason.clone());
        }
    }

    /// What a robot uses that says it has applied something; unknown when nobody can say.
    fn now_uses(&self, shadow: &mut Shadow, applied: &Applied, revision: Option<u64>) {
        let generation = applied.generation;
        let known = revision.and_then(|id| self.outcome.ledger.revisions.get(&id));
        let held = shadow.in_use.clone().filter(|_| shadow.uses(generation));
        if held.is_none() {
            shadow.before = shadow.in_use.take();
        }
        let values = applied.values.or(known.map(|revision| revision.values));
        let values = values.or(held.as_ref().map(|held| held.values));
        let revision = revision.or(held.and_then(|held| held.revision));
        shadow.in_use = values.map(|values| InUse {
            generation,
            revision: revision.filter(|_| generation > 0),
            values,
            since_ns: applied.applied_at_ns,
        });
    }

    fn judge(&mut self, id: u64, verification: Verification) -> Result<(), Refused> {
        let before = self.underway(id)?;
        let mut live = before.clone();
        live.verification = Some(verification);
        if verification.within {
            live.reason = None;
            let event = DeploymentEvent::Verified;
            self.advance(&before, live, event, "deployment.verify", None)?;
            let mut shadow = self.outcome.ledger.shadow.clone();
            shadow.verified.push(before.offer);
            let surplus = shadow.verified.len().saturating_sub(Shadow::VERIFIED_MAX);
            shadow.verified.drain(..surplus);
            self.save_shadow("shadow.remember", shadow, None);
            return Ok(());
        }
        let reason = "a fresh estimate disagrees with what the robot uses".to_owned();
        // The verdict is written down before what follows from it.
        let event = DeploymentEvent::VerificationFailed;
        let action = "deployment.fail_verification";
        self.advance(&before, live, event, action, Some(reason.clone()))?;
        if !self.standing.policy.roll_back {
            return Ok(());
        }
        match self.roll_back(reason) {
            // Somebody has to decide what the robot shall use instead.
            Err(Refused::NothingToReturnTo) => Ok(()),
            other => other,
        }
    }

    fn give_up(&mut self, id: u64, reason: String) -> Result<(), Refused> {
        let before = self.underway(id)?;
        let (event, action) = match before.state {
            DeploymentState::Verifying => (
                DeploymentEvent::TooLittleMotion,
                "deployment.leave_inconclusive",
            ),
            _ => (DeploymentEvent::TimeOut, "deployment.time_out"),
        };
        self.advance(&before, before.clone(), event, action, Some(reason))
    }

    fn void(&mut self, id: u64, reason: String) -> Result<(), Refused> {
        let before = self.underway(id)?;
        match before.state {
            DeploymentState::Queued | DeploymentState::Offered => self.roll_back(reason),
            state => Err(Refused::Deployment {
                state,
                event: DeploymentEvent::RollBack,
            }),
        }
    }

    fn underway(&self, id: u64) -> Result<Deployment, Refused> {
        let live = self.outcome.ledger.live.as_ref();
        live.filter(|live| live.id == id)
            .cloned()
            .ok_or(Refused::NotUnderway(id))
    }

    /// Moves a deployment on and writes it down.
    pub(super) fn advance(
        &mut self,
        before: &Deployment,
        mut after: Deployment,
        event: DeploymentEvent,
        action: &'static str,
        reason: Option<String>,
    ) -> Result<(), Refused> {
        after.state = before.state.after(event)?;
        after.version += 1;
        if reason.is_some() {
            after.reason.clone_from(&reason);
        }
        if !after.state.is_live() {
            after.closed_ns = Some(self.standing.now_ns);
        }
        self.settle(&after);
        self.save_deployment(action, Some(before), after, reason);
        Ok(())
    }

    /// What the end of a deployment leaves the robot with.
    fn settle(&mut self, deployment: &Deployment) {
        use DeploymentState as S;
        let given_up = matches!(
            deployment.state,
            S::Refused | S::Failed | S::TimedOut | S::Withdrawn
        );
        if given_up {
            let mut shadow = self.outcome.ledger.shadow.clone();
            shadow.desired.clone_from(&deployment.desired_before);
            self.save_shadow("shadow.desire", shadow, None);
        }
        if matches!(deployment.state, S::Refused | S::Failed | S::Withdrawn) {
            self.decline(deployment.offer.revision);
        }
    }

    /// The service does not propose this again by itself.
    pub(super) fn decline(&mut self, revision: u64) {
        let mut shadow = self.outcome.ledger.shadow.clone();
        if shadow.declined != Some(revision) {
            shadow.declined = Some(revision);
            self.save_shadow("shadow.decline", shadow, None);
        }
    }

    pub(super) fn add_revision(
        &mut self,
        origin: Origin,
        values: (CalibrationValues, CalibrationValues),
        evidence: Evidence,
    ) -> Revision {
        let robot = self.outcome.ledger.shadow.robot.clone();
        let id = self.ids.revision;
        self.ids.revision += 1;
        let revision = Revision::new(id, robot, origin, values, evidence, self.standing.now_ns);
        self.outcome.ledger.revisions.insert(id, revision.clone());
        self.outcome.revisions.push(revision.clone());
        revision
    }

    fn save_proposal(
        &mut self,
        action: &'static str,
        before: Option<&Proposal>,
        after: Proposal,
        reason: Option<String>,
    ) {
        let id = after.id.to_string();
        self.note(Subject::Proposal, id, action, before, &after, reason);
        self.outcome.ledger.open =
            Some(after.clone()).filter(|one| one.state == ProposalState::Proposed);
        self.outcome.proposals.push(after);
    }

    pub(super) fn save_deployment(
        &mut self,
        action: &'static str,
        before: Option<&Deployment>,
        after: Deployment,
        reason: Option<String>,
    ) {
        let id = after.id.to_string();
        self.note(Subject::Deployment, id, action, before, &after, reason);
        self.outcome.ledger.live = Some(after.clone()).filter(|one| one.state.is_live());
        self.outcome.deployments.push(after);
    }

    pub(super) fn save_shadow(
        &mut self,
        action: &'static str,
        mut after: Shadow,
        reason: Option<String>,
    ) {
        let before = self.outcome.ledger.shadow.clone();
        after.version += 1;
        let id = after.robot.to_string();
        self.note(Subject::Shadow, id, action, Some(&before), &after, reason);
        self.outcome.ledger.shadow = after;
        self.outcome.shadow_changed = true;
    }

    fn note<T: Serialize>(
        &mut self,
        subject: Subject,
        subject_id: String,
        action: &'static str,
        before: Option<&T>,
        after: &T,
        reason: Option<String>,
    ) {
        self.outcome.transitions.push(Transition {
            subject,
            subject_id,
            action,
            before: before.map(json),
            after: json(after),
            reason,
        });
    }
}

/// The records hold finite numbers and text, which JSON can carry.
fn json<T: Serialize>(record: &T) -> Value {
    serde_json::to_value(record).unwrap_or(Value::Null)
}

pub(super) fn after(now_ns: i64, seconds: u32) -> i64 {
    now_ns.saturating_add(i64::from(seconds).saturating_mul(NS_PER_S))
}

fn said(reason: String) -> Result<String, Refused> {
    if reason.trim().is_empty() {
        return Err(Refused::ReasonMissing);
    }
    Ok(reason)
}

fn fresh(expected: Option<u64>, found: u64) -> Result<(), Refused> {
    if expected.is_some_and(|expected| expected != found) {
        return Err(Refused::Stale { found });
    }
    Ok(())
}

fn same_document(offer: &GenerationRef, applied: &Applied) -> Result<(), Refused> {
    if offer.sha256 != applied.sha256 {
        return Err(Refused::OtherDocument {
            generation: applied.generation,
            given: applied.sha256.clone(),
            found: offer.sha256.clone(),
        });
    }
    Ok(())
}

/// What no robot can have is not even proposed.
fn within_limits(values: &CalibrationValues, policy: &Policy) -> Result<(), Refused> {
    let steering_rad = policy.steering_offset_max_deg.to_radians();
    let distance_m = policy.lidar_distance_max_m;
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
        if !(value.abs() <= most) {
            let accepted = format!("{:.4} to {most:.4}", -most);
            return Err(Refused::OutOfLimits {
                field,
                value,
                accepted,
            });
        }
    }
    let positive = [
        ("speed_scale", values.speed_scale),
        ("wheelbase_m", values.wheelbase_m),
        ("steering_gain", values.steering_gain),
    ];
    for (field, value) in positive {
        if let Some(value) = value.filter(|value| !(*value > 0.0 && *value <= 30.0)) {
            return Err(Refused::OutOfLimits {
                field,
                value,
                accepted: "more than 0 and at most 30".to_owned(),
            });
        }
    }
    match values.time_offset_s.filter(|value| !(value.abs() <= 10.0)) {
        Some(value) => Err(Refused::OutOfLimits {
            field: "time_offset_s",
            value,
            accepted: "-10 to 10".to_owned(),
        }),
        None => Ok(()),
    }
}
