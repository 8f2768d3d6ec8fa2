//! The life cycle's records as the store keeps them.

use std::sync::Arc;

use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Envelope;
use fleetcal_proto::estimate::PoseDocument;
use fleetcal_proto::signing::SigningKey;
use serde::Serialize;

use super::Store;
use super::audit::AuditEntry;
use super::error::StoreError;
use super::record::{EventKind, EventSource, IdempotencyKey, NewEvent};
use super::writer::Command;
use crate::access::{Actor, Authentication, Role};
use crate::approval::{
    self, Deployment, Outcome, Parcel, Policy, Proposal, ProposalState, Revision, RobotLedger,
    Transition,
};

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
    pub rear_axle_in_base_link: Option<PoseDocument>,
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
#[derive(Debug, Clone, PartialEq, Eq, Serialize, utoipa::ToSchema)]
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
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
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
    #[schema(value_type = Option<Object>)]
    pub before: Option<serde_json::Value>,
    /// The record after.
    #[schema(value_type = Option<Object>)]
    pub after: Option<serde_json::Value>,
    /// Why.
    pub reason: Option<String>,
}

impl Decision {
    /// The rows of the audit that an outcome asks for.
    pub(super) fn audit(&self, outcome: &Outcome) -> Vec<AuditEntry> {
        let entry = |transition: &Transition| AuditEntry {
            at_ns: self.now_ns,
            actor: self.actor.clone(),
            action: transition.action,
            subject: transition.subject.as_str(),
            subject_id: transition.subject_id.clone(),
            robot: Some(self.robot.clone()),
            before: transition.before.clone(),
            after: Some(transition.after.clone()),
            reason: transition.reason.clone(),
        };
        outcome.transitions.iter().map(entry).collect()
    }

    /// What an outcome puts into the robot's history.
    pub(super) fn events(&self, outcome: &Outcome) -> Vec<NewEvent> {
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
            let (generation, values) = match kind {
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
                note: transition.reason.clone(),
                details: Some(serde_json::json!({
                    transition.subject.as_str(): transition.subject_id,
                    "generation": generation,
                    "values": values,
                })),
            })
        };
        outcome.transitions.iter().filter_map(event).collect()
    }
}

/// The kind under which a transition is kept in its robot's history.
fn kind_of_transition(transition: &Transition) -> Option<EventKind> {
    let state = transition
        .after
        .get("state")
        .and_then(|state| state.as_str());
    let rollback_ended = match state {
        Some("rolled_back") => Some(EventKind::RolledBack),
        Some("rollback_failed") => Some(EventKind::RollbackFailed),
        _ => None,
    };
    match transition.action {
        "proposal.create" => Some(EventKind::Proposed),
        "proposal.approve" => Some(EventKind::Approved),
        "proposal.reject" | "proposal.expire" | "proposal.withdraw" | "proposal.supersede" => {
            Some(EventKind::ProposalClosed)
        }
        "deployment.offer" => Some(EventKind::Offered),
        "deployment.apply" => rollback_ended.or(Some(EventKind::Applied)),
        "deployment.refuse" | "deployment.fail" | "deployment.revert" | "deployment.time_out" => {
            rollback_ended.or(Some(EventKind::NotApplied))
        }
        "deployment.verify" => Some(EventKind::Verified),
        "deployment.fail_verification" => Some(EventKind::VerificationFailed),
        "deployment.leave_inconclusive" => Some(EventKind::Inconclusive),
        "deployment.roll_back" => Some(EventKind::RollingBack),
        _ => None,
    }
}

impl Store {
    /// Takes a command on a robot's records and waits until all of it is committed.
    ///
    /// # Errors
    /// [`StoreError::Refused`] when it does not fit them, [`StoreError::KeyReused`], or the
    /// database's failure; nothing has changed then.
    pub async fn decide(&self, decision: Decision) -> Result<Decided, StoreError> {
        self.ask(|reply| Command::Decide(Box::new(decision), reply))
            .await
    }

    /// Holds or releases the site-wide stop.
    ///
    /// # Errors
    /// [`StoreError::Refused`] when it changed since it was looked at; otherwise the database's
    /// failure.
    pub async fn hold(&self, write: HoldWrite) -> Result<SiteHold, StoreError> {
        self.ask(|reply| Command::Hold(Box::new(write), reply))
            .await
    }

    /// The records of every robot that has any.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn load_ledgers(&self) -> Result<Vec<RobotLedger>, StoreError> {
        self.shared.reader.ledgers().await
    }

    /// A signed document.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn envelope(
        &self,
        robot: &RobotId,
        generation: u64,
    ) -> Result<Option<Envelope>, StoreError> {
        self.shared.reader.envelope(robot, generation).await
    }

    /// What is to be sent, and was not.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn outbox(&self) -> Result<Vec<(RobotId, Parcel)>, StoreError> {
        self.shared.reader.outbox().await
    }

    /// Proposals with what they propose, newest first.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn proposals(
        &self,
        filter: &ProposalFilter,
    ) -> Result<Vec<(Proposal, Revision)>, StoreError> {
        self.shared.reader.proposals(filter).await
    }

    /// One proposal with what it proposes.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn proposal(&self, id: u64) -> Result<Option<(Proposal, Revision)>, StoreError> {
        self.shared.reader.proposal(id).await
    }

    /// A robot's deployments before number `before`, newest first.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn deployments(
        &self,
        robot: &RobotId,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<Deployment>, StoreError> {
        self.shared.reader.deployments(robot, before, limit).await
    }

    /// The site-wide stop.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn site_hold(&self) -> Result<SiteHold, StoreError> {
        self.shared.reader.site_hold().await
    }

    /// Rows of the audit, newest first.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn audit(&self, filter: &AuditFilter) -> Result<Vec<AuditRow>, StoreError> {
        self.shared.reader.audit(filter).await
    }
}
