//! Draft of a step: the records as they will be, and each change of one.

use std::time::Duration;

use fleetcal_model::{DeploymentId, Generation, Pose2, RevisionId, Version, WallTime};
use fleetcal_proto::calibration::CalibrationValues;

use super::command::Standing;
use super::deployment::{Deployment, DeploymentEvent, DeploymentState};
use super::ledger::{NextIds, Outcome, RobotLedger};
use super::proposal::{Proposal, ProposalState};
use super::refused::Refused;
use super::revision::{Evidence, Origin, Revision};
use super::shadow::Shadow;
use super::transition::{Changed, DeploymentAction, ProposalAction, ShadowAction, Transition};
use super::values::Change;

/// Draft of a step.
pub(super) struct Draft<'a> {
    pub(super) standing: &'a Standing<'a>,
    pub(super) ids: NextIds,
    pub(super) outcome: Outcome,
    /// Sum of automatic steps after the next change of the shadow. A person's decision resets it
    /// and settles a contradiction.
    pub(super) automatic_sum: Option<Change>,
}

impl<'a> Draft<'a> {
    pub(super) fn new(ledger: &RobotLedger, ids: NextIds, standing: &'a Standing<'a>) -> Self {
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
                outbox: Vec::new(),
                sent: None,
                transitions: Vec::new(),
            },
            automatic_sum: None,
        }
    }

    pub(super) fn live_offer(&self, generation: Generation) -> Option<Deployment> {
        let live = self.outcome.ledger.live.as_ref();
        live.filter(|live| live.offer.generation == generation)
            .cloned()
    }

    pub(super) fn underway(&self, id: DeploymentId) -> Result<Deployment, Refused> {
        let live = self.outcome.ledger.live.as_ref();
        live.filter(|live| live.id == id)
            .cloned()
            .ok_or(Refused::NotUnderway(id))
    }

    /// Applies an event to a deployment and records the change.
    pub(super) fn advance(
        &mut self,
        before: &Deployment,
        mut after: Deployment,
        event: DeploymentEvent,
        action: DeploymentAction,
        reason: Option<String>,
    ) -> Result<(), Refused> {
        after.state = before.state.after(event)?;
        after.version = after.version.next();
        if reason.is_some() {
            after.reason.clone_from(&reason);
        }
        if !after.state.is_live() {
            after.closed_ns = Some(self.standing.now);
        }
        self.settle(&after);
        self.save_deployment(action, Some(before), after, reason);
        Ok(())
    }

    /// Updates the shadow at the end of a deployment.
    fn settle(&mut self, deployment: &Deployment) {
        use DeploymentState as S;
        let given_up = matches!(
            deployment.state,
            S::Refused | S::Failed | S::TimedOut | S::Withdrawn
        );
        // A robot that is away for long still goes back to what a person chose when it returns.
        let is_awaited = deployment.is_return() && deployment.state == S::TimedOut;
        if given_up && !is_awaited {
            let mut shadow = self.outcome.ledger.shadow.clone();
            shadow.desired.clone_from(&deployment.desired_before);
            self.save_shadow(ShadowAction::Desire, shadow, None);
        }
        if matches!(deployment.state, S::Refused | S::Failed | S::Withdrawn) {
            self.decline(deployment.offer.revision);
        }
    }

    /// Declines a revision, which the service then does not propose again by itself.
    pub(super) fn decline(&mut self, revision: RevisionId) {
        let mut shadow = self.outcome.ledger.shadow.clone();
        if shadow.declined != Some(revision) {
            shadow.declined = Some(revision);
            self.save_shadow(ShadowAction::Decline, shadow, None);
        }
    }

    pub(super) fn add_revision(
        &mut self,
        origin: Origin,
        values: (CalibrationValues, CalibrationValues),
        evidence: Evidence,
        rear_axle: Option<Pose2>,
    ) -> Revision {
        let robot = self.outcome.ledger.shadow.robot.clone();
        let id = self.ids.revision;
        self.ids.revision = self.ids.revision.next();
        let now = self.standing.now;
        let revision = Revision::new(id, robot, origin, values, evidence, rear_axle, now);
        self.outcome.ledger.revisions.insert(id, revision.clone());
        self.outcome.revisions.push(revision.clone());
        revision
    }

    pub(super) fn save_proposal(
        &mut self,
        action: ProposalAction,
        before: Option<&Proposal>,
        after: Proposal,
        reason: Option<String>,
    ) {
        self.note(Transition::Proposal(Box::new(Changed {
            action,
            before: before.cloned(),
            after: after.clone(),
            reason,
        })));
        self.outcome.ledger.open =
            Some(after.clone()).filter(|one| one.state == ProposalState::Proposed);
        self.outcome.proposals.push(after);
    }

    pub(super) fn save_deployment(
        &mut self,
        action: DeploymentAction,
        before: Option<&Deployment>,
        after: Deployment,
        reason: Option<String>,
    ) {
        self.note(Transition::Deployment(Box::new(Changed {
            action,
            before: before.cloned(),
            after: after.clone(),
            reason,
        })));
        self.outcome.ledger.live = Some(after.clone()).filter(|one| one.state.is_live());
        self.outcome.deployments.push(after);
    }

    pub(super) fn save_shadow(
        &mut self,
        action: ShadowAction,
        mut after: Shadow,
        reason: Option<String>,
    ) {
        after.version = after.version.next();
        if let Some(sum) = self.automatic_sum.take() {
            after.automatic_sum = sum;
            if sum.iter().all(|step| *step == 0.0) {
                after.contradicted = None;
            }
        }
        let before = std::mem::replace(&mut self.outcome.ledger.shadow, after.clone());
        self.note(Transition::Shadow(Box::new(Changed {
            action,
            before: Some(before),
            after,
            reason,
        })));
        self.outcome.shadow_changed = true;
    }

    fn note(&mut self, transition: Transition) {
        self.outcome.transitions.push(transition);
    }
}

pub(super) fn after(now: WallTime, seconds: u32) -> WallTime {
    now.plus(Duration::from_secs(seconds.into()))
}

pub(super) fn fresh(expected: Option<Version>, found: Version) -> Result<(), Refused> {
    if expected.is_some_and(|expected| expected != found) {
        return Err(Refused::Stale { found });
    }
    Ok(())
}
