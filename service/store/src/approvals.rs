//! The life cycle's records as the store keeps them.

use std::sync::Arc;

use fleetcal_domain::access::{Actor, Authentication, Role};
use fleetcal_domain::approval::{
    self, DeploymentAction, DeploymentState, Outcome, Policy, Proposal, ProposalAction,
    ProposalState, ShadowAction, Transition, audited,
};
use fleetcal_model::Pose2;
use fleetcal_proto::RobotId;
use fleetcal_proto::signing::SigningKey;
use serde::Serialize;

use super::audit::AuditEntry;
use super::record::{EventKind, EventSource, IdempotencyKey, NewEvent};

/// A command on one robot's records, to be taken in one transaction.
#[derive(Debug, Clone)]
pub struct Decision {
    /// Whose records.
    pub robot: RobotId,
    /// What is asked.
    pub command: approval::Command,
    /// Who asks.
    pub actor: Actor,
    /// The rules of the configuration file, which count where none were set.
    pub given_policy: Arc<Policy>,
    /// What documents are signed with.
    pub key: Arc<SigningKey>,
    /// Wall time.
    pub now_ns: i64,
    /// What makes a repeated request recognisable.
    pub idempotency: Option<IdempotencyKey>,
    /// Where the robot's rear axle is in its `base_link`, where that is configured.
    pub rear_axle_in_base_link: Option<Pose2>,
    /// What its estimator says at this moment.
    pub present: approval::Present,
}

/// What became of a decision.
#[derive(Debug, Clone)]
pub enum Decided {
    /// It was taken and is committed.
    Taken(Box<Outcome>),
    /// The same request was answered before, with this proposal.
    Repeated(Box<Proposal>),
}

/// Whether the site-wide stop is held.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SiteHold {
    /// Goes up with every change of it.
    pub version: u64,
    /// Whether it is held.
    pub held: bool,
    /// Who changed it last.
    pub by: Option<String>,
    /// When, ns since 1970, wall time.
    pub at_ns: Option<i64>,
    /// Why.
    pub reason: Option<String>,
}

/// A change of the site-wide stop.
#[derive(Debug, Clone)]
pub struct HoldWrite {
    /// Whether it is to be held.
    pub held: bool,
    /// The version that was looked at.
    pub version: u64,
    /// Who.
    pub actor: Actor,
    /// When, wall time.
    pub now_ns: i64,
    /// Why.
    pub reason: String,
}

/// Which proposals are asked for.
#[derive(Debug, Clone, Default)]
pub struct ProposalFilter {
    /// Of one robot.
    pub robot: Option<RobotId>,
    /// In one state.
    pub state: Option<ProposalState>,
    /// Below this number.
    pub before: Option<i64>,
    /// At most so many.
    pub limit: u32,
}

/// Which rows of the audit are asked for.
#[derive(Debug, Clone, Default)]
pub struct AuditFilter {
    /// About one robot.
    pub robot: Option<RobotId>,
    /// By one actor.
    pub actor: Option<String>,
    /// Actions that begin so.
    pub action: Option<String>,
    /// From this wall time on, ns.
    pub from_ns: Option<i64>,
    /// Before this wall time, ns.
    pub to_ns: Option<i64>,
    /// Below this number.
    pub before: Option<i64>,
    /// At most so many.
    pub limit: u32,
}

/// A row of the audit.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct AuditRow {
    /// Its number.
    pub id: i64,
    /// When, ns since 1970, wall time.
    pub at_ns: i64,
    /// Who.
    pub actor: String,
    /// How that is known.
    pub authentication: String,
    /// What the actor might do.
    pub role: Option<String>,
    /// The HTTP request's id.
    pub request: Option<String>,
    /// What was done.
    pub action: String,
    /// To what kind of record.
    pub subject: String,
    /// To which one.
    pub subject_id: String,
    /// The robot it is about.
    pub robot: Option<String>,
    /// The record before.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Object>))]
    pub before: Option<serde_json::Value>,
    /// The record after.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Object>))]
    pub after: Option<serde_json::Value>,
    /// Why.
    pub reason: Option<String>,
}

impl Decision {
    /// The rows of the audit that an outcome asks for.
    pub fn audit(&self, outcome: &Outcome) -> Vec<AuditEntry> {
        let entry = |transition: &Transition| {
            let (before, after) = audited(transition);
            AuditEntry {
                at_ns: self.now_ns,
                actor: self.actor.clone(),
                action: transition.action(),
                subject: transition.subject(),
                subject_id: transition.subject_id(),
                robot: Some(self.robot.clone()),
                before,
                after: Some(after),
                reason: transition.reason().map(str::to_owned),
            }
        };
        outcome.transitions.iter().map(entry).collect()
    }

    /// What an outcome puts into the robot's history.
    pub fn events(&self, outcome: &Outcome) -> Vec<NewEvent> {
        let source = match self.actor.authentication {
            Authentication::Service => EventSource::Service,
            Authentication::Zenoh => EventSource::Robot,
            // It may answer over HTTP as well.
            _ if self.actor.role == Some(Role::Robot) => EventSource::Robot,
            _ => EventSource::Person,
        };
        let event = |transition: &Transition| {
            let kind = kind_of_transition(transition)?;
            let in_use = outcome.ledger.shadow.in_use.as_ref();
            let live = outcome.ledger.live.as_ref();
            let going_back = live.and_then(|live| Some((live, live.roll_back.as_ref()?)));
            let (generation, values) = match kind {
                EventKind::RollingBack => (
                    going_back.map(|(live, _)| live.offer.generation),
                    going_back.map(|(_, roll_back)| roll_back.values),
                ),
                EventKind::Applied | EventKind::RolledBack => (
                    in_use.map(|in_use| in_use.generation),
                    in_use.map(|in_use| in_use.values),
                ),
                _ => (None, None),
            };
            Some(NewEvent {
                robot: self.robot.clone(),
                kind,
                stamp_ns: self.now_ns,
                received_ns: self.now_ns,
                source,
                author: (source == EventSource::Person).then(|| self.actor.name.clone()),
                note: transition.reason().map(str::to_owned),
                details: Some(serde_json::json!({
                    transition.subject(): transition.subject_id(),
                    "generation": generation,
                    "values": values,
                })),
            })
        };
        outcome.transitions.iter().filter_map(event).collect()
    }
}

/// The kind under which a transition is kept in its robot's history; `None` of one that is in the
/// audit alone.
fn kind_of_transition(transition: &Transition) -> Option<EventKind> {
    match transition {
        Transition::Proposal(change) => kind_of_proposal(change.action),
        // A proposal's deployment is told by its approval; one without is a person's roll-back.
        Transition::Deployment(change)
            if change.action == DeploymentAction::Create && change.after.is_return() =>
        {
            Some(EventKind::RollingBack)
        }
        Transition::Deployment(change) => kind_of_deployment(change.action, change.after.state),
        Transition::Shadow(change) => match change.action {
            ShadowAction::Desire
            | ShadowAction::Decline
            | ShadowAction::Report
            | ShadowAction::Remember
            | ShadowAction::Forget
            | ShadowAction::BeginMaintenance
            | ShadowAction::EndMaintenance => None,
        },
    }
}

const fn kind_of_proposal(action: ProposalAction) -> Option<EventKind> {
    match action {
        ProposalAction::Create => Some(EventKind::Proposed),
        ProposalAction::Refresh => Some(EventKind::ProposalRefreshed),
        ProposalAction::ApproveInPart => None,
        ProposalAction::Approve => Some(EventKind::Approved),
        ProposalAction::Reject
        | ProposalAction::Expire
        | ProposalAction::Withdraw
        | ProposalAction::Supersede => Some(EventKind::ProposalClosed),
    }
}

const fn kind_of_deployment(action: DeploymentAction, after: DeploymentState) -> Option<EventKind> {
    match (action, after) {
        (DeploymentAction::Create | DeploymentAction::Confirm, _) => None,
        (DeploymentAction::Offer, _) => Some(EventKind::Offered),
        // Any answer can be the one that ends a roll-back.
        (
            DeploymentAction::Apply
            | DeploymentAction::Refuse
            | DeploymentAction::Fail
            | DeploymentAction::Revert
            | DeploymentAction::TimeOut,
            DeploymentState::RolledBack,
        )
        // No robot had seen it: the former values are in use, and nothing is on its way.
        | (DeploymentAction::RollBack, DeploymentState::Withdrawn) => Some(EventKind::RolledBack),
        (
            DeploymentAction::Apply
            | DeploymentAction::Refuse
            | DeploymentAction::Fail
            | DeploymentAction::Revert
            | DeploymentAction::TimeOut,
            DeploymentState::RollbackFailed,
        ) => Some(EventKind::RollbackFailed),
        (DeploymentAction::Apply, _) => Some(EventKind::Applied),
        (
            DeploymentAction::Refuse
            | DeploymentAction::Fail
            | DeploymentAction::Revert
            | DeploymentAction::TimeOut,
            _,
        ) => Some(EventKind::NotApplied),
        (DeploymentAction::Verify, _) => Some(EventKind::Verified),
        (DeploymentAction::FailVerification | DeploymentAction::Keep, _) => {
            Some(EventKind::VerificationFailed)
        }
        (DeploymentAction::LeaveInconclusive, _) => Some(EventKind::Inconclusive),
        (DeploymentAction::RollBack, _) => Some(EventKind::RollingBack),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_robots_answer_that_ends_a_roll_back_is_told_as_its_end() {
        use DeploymentAction as A;
        use DeploymentState as S;
        for (action, after, kind) in [
            (A::Apply, S::Applied, EventKind::Applied),
            (A::Apply, S::RolledBack, EventKind::RolledBack),
            (A::Refuse, S::Refused, EventKind::NotApplied),
            (A::Refuse, S::RollbackFailed, EventKind::RollbackFailed),
            (A::Fail, S::Failed, EventKind::NotApplied),
            (A::Revert, S::RollbackFailed, EventKind::RollbackFailed),
            (A::TimeOut, S::TimedOut, EventKind::NotApplied),
            (A::TimeOut, S::RollbackFailed, EventKind::RollbackFailed),
            (A::RollBack, S::Withdrawn, EventKind::RolledBack),
            (A::RollBack, S::RollingBack, EventKind::RollingBack),
            (
                A::LeaveInconclusive,
                S::Inconclusive,
                EventKind::Inconclusive,
            ),
            (
                A::FailVerification,
                S::Verifying,
                EventKind::VerificationFailed,
            ),
        ] {
            assert_eq!(kind_of_deployment(action, after), Some(kind), "{action:?}");
        }
        assert_eq!(kind_of_deployment(A::Confirm, S::Verifying), None);
        assert_eq!(kind_of_deployment(A::Create, S::Queued), None);
        let keep = kind_of_deployment(A::Keep, S::Kept);
        assert_eq!(keep, Some(EventKind::VerificationFailed));
    }
}
