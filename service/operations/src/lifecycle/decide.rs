//! A decision on one robot's records: they are loaded, the pure [`step`] is taken, and what it
//! leaves is saved with its audit, its history and its messages, in one transaction.

use std::sync::Arc;

use async_trait::async_trait;
use fleetcal_cluster::Tenure;
use fleetcal_domain::access::{Actor, Authentication, Role};
use fleetcal_domain::alert::{AlertKind, Subject};
use fleetcal_domain::approval::{
    Command, Drawing, Outcome, Policy, Present, Proposal, Refused, Standing, Transition, audited,
    automatic, nominal_values, step,
};
use fleetcal_domain::limits;
use fleetcal_domain::robot::RobotView;
use fleetcal_domain::standing::{self, RobotAlerts, StandingBasis};
use fleetcal_domain::webhook::Message;
use fleetcal_model::{NoteKind, Pose2, ProposalId, RobotTime, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::signing::SigningKey;
use fleetcal_store::transaction::AnswerScope;
use fleetcal_store::{
    AuditEntry, EventKind, EventSource, IdempotencyKey, Job, NewEvent, Records, RobotRecord,
    StoreError,
};

use super::history;
use crate::answers::{made_before, note_made};
use crate::notes;
use crate::webhook_dispatcher::outbox;

/// A command on one robot's records, to be taken in one transaction.
#[derive(Debug, Clone)]
pub struct Decide {
    /// Whose records.
    pub robot: RobotId,
    /// What is asked.
    pub command: Command,
    /// Who asks.
    pub actor: Actor,
    /// The tenure by which the service asks by itself, where there are several instances: without
    /// it, it decides nothing.
    pub tenure: Option<Tenure>,
    /// The rules of the configuration file, which count where none were set.
    pub given_policy: Arc<Policy>,
    /// What documents are signed with.
    pub key: Arc<SigningKey>,
    /// Wall time.
    pub now: WallTime,
    /// What makes a repeated request recognisable.
    pub idempotency: Option<IdempotencyKey>,
    /// Where the robot's rear axle is in its `base_link`, where that is configured.
    pub rear_axle_in_base_link: Option<Pose2>,
    /// What its estimator says at this moment.
    pub present: Present,
    /// The robot as it is seen at this moment; `None` of one that the fleet does not know.
    pub view: Option<Box<RobotView>>,
}

/// What became of a decision.
#[derive(Debug, Clone)]
pub enum Decided {
    /// It was taken and is committed.
    Taken(Box<Outcome>),
    /// The same request was answered before, with this proposal.
    Repeated(Box<Proposal>),
}

#[async_trait]
impl Job for Decide {
    type Done = Decided;

    async fn run(&self, records: &mut dyn Records) -> Result<Decided, StoreError> {
        if let Some(tenure) = &self.tenure
            && !records.holds_tenure(tenure).await?
        {
            return Err(StoreError::Fenced(self.robot.clone()));
        }
        if let Some(proposal) = self.answered(records).await? {
            return Ok(Decided::Repeated(Box::new(proposal)));
        }
        let policy = records.stored_policy().await?.policy;
        let policy = policy.unwrap_or(*self.given_policy);
        let outcome = self.step(records, &policy).await?;
        records.save_outcome(&outcome).await?;
        for entry in self.audit(&outcome) {
            records.append_audit(&entry).await?;
        }
        for event in self.events(&outcome) {
            records.add_event(&event).await?;
        }
        self.tell(records, &outcome, &policy).await?;
        self.note_answer(records, &outcome).await?;
        Ok(Decided::Taken(Box::new(outcome)))
    }
}

impl Decide {
    async fn step(
        &self,
        records: &mut dyn Records,
        policy: &Policy,
    ) -> Result<Outcome, StoreError> {
        let answered = match &self.command {
            Command::Acknowledge(applied) => Some(applied.generation),
            _ => None,
        };
        let ledger = records.ledger(&self.robot, answered).await?;
        let frozen = match self.command {
            Command::Offer { .. } => records.deployment_freeze().await?.frozen,
            _ => false,
        };
        let ids = records.next_ids().await?;
        let robot = records.robot(&self.robot).await?;
        let standing = Standing {
            policy,
            key: &self.key,
            actor: &self.actor,
            now: self.now,
            frozen,
            rear_axle_in_base_link: self.rear_axle_in_base_link,
            present: self.present_beside_notes(records).await?,
            drawing: robot.and_then(drawing),
        };
        match step(&ledger, self.command.clone(), ids, &standing) {
            Ok(outcome) => Ok(outcome),
            Err(Refused::NotOpen(id)) => {
                let closed = records.proposal(id).await?;
                Err(Refused::not_open(id, closed.as_ref(), self.command.version()).into())
            }
            Err(refused) => Err(refused.into()),
        }
    }

    /// What the estimator says at this moment. Its latest estimate may be from before a reassembly that is
    /// reported already: then nothing is known.
    async fn present_beside_notes(&self, records: &mut dyn Records) -> Result<Present, StoreError> {
        let asks_people = matches!(
            self.command,
            Command::Propose { .. } | Command::Refresh { .. } | Command::Approve { .. }
        );
        let taken = self.view.as_ref().and_then(|view| view.notes_taken);
        let Some(taken) = taken.filter(|_| asks_people) else {
            return Ok(self.present);
        };
        let rows = records
            .notes_after(&self.robot, taken, limits::NOTES_BROUGHT_MAX)
            .await?;
        let notes = rows.iter().filter_map(notes::event_of);
        let is_reassembled = notes
            .into_iter()
            .any(|note| note.kind == NoteKind::Reassembled);
        Ok(if is_reassembled {
            Present::Reassembled
        } else {
            self.present
        })
    }

    /// The proposal with which the same request was answered before.
    async fn answered(&self, records: &mut dyn Records) -> Result<Option<Proposal>, StoreError> {
        let scope = AnswerScope::Proposal(&self.robot);
        match made_before(records, scope, self.idempotency.as_ref()).await? {
            Some(id) => records.proposal(ProposalId(id.unsigned_abs())).await,
            None => Ok(None),
        }
    }

    async fn note_answer(
        &self,
        records: &mut dyn Records,
        outcome: &Outcome,
    ) -> Result<(), StoreError> {
        let Some(proposal) = outcome.proposals.last() else {
            return Ok(());
        };
        let scope = AnswerScope::Proposal(&self.robot);
        let (key, id) = (self.idempotency.as_ref(), proposal.id.0 as i64);
        note_made(records, scope, key, id, self.now).await
    }

    /// Tells webhooks what waits for people now.
    async fn tell(
        &self,
        records: &mut dyn Records,
        outcome: &Outcome,
        policy: &Policy,
    ) -> Result<(), StoreError> {
        // What the service approves by itself waits for nobody.
        if automatic(&outcome.ledger, policy).is_some() {
            return Ok(());
        }
        let of_proposal = |transition: &Transition| matches!(transition, Transition::Proposal(_));
        if !outcome.transitions.iter().any(of_proposal) {
            return Ok(());
        }
        let stands = self.stands(records, outcome, policy).await?;
        for transition in &outcome.transitions {
            let message = Message::of_transition(transition, outcome, stands, self.now);
            if let Some(message) = message.map_err(|error| outbox::unwritable(&error))? {
                outbox::tell(records, &message, self.now).await?;
            }
        }
        Ok(())
    }
}

/// The drawing that a robot is configured with, and who gave it.
fn drawing(robot: RobotRecord) -> Option<Drawing> {
    let mount = robot.config?.nominal_extrinsics?;
    Some(Drawing {
        values: nominal_values(&mount.pose()),
        by: robot.drawn_by,
    })
}

impl Decide {
    /// How the robot stands with an outcome.
    async fn stands(
        &self,
        records: &mut dyn Records,
        outcome: &Outcome,
        policy: &Policy,
    ) -> Result<Option<standing::Standing>, StoreError> {
        let Some(view) = self.view.as_deref() else {
            return Ok(None);
        };
        let mut active = Vec::new();
        for kind in AlertKind::ALL {
            for subject in [Subject::Robot(self.robot.clone()), Subject::Fleet] {
                active.extend(records.active_alert(&subject, kind).await?);
            }
        }
        let mut alerts = RobotAlerts::by_robot(&active);
        let alerts = alerts.remove(&self.robot).unwrap_or_default();
        let tolerance = &policy.propose_beyond;
        let basis = StandingBasis::of(view, &outcome.ledger, tolerance, self.now);
        Ok(Some(basis.with(&alerts)))
    }

    /// The rows of the audit that an outcome asks for.
    fn audit(&self, outcome: &Outcome) -> Vec<AuditEntry> {
        let entry = |transition: &Transition| {
            let (before, after) = audited(transition);
            AuditEntry {
                at_ns: self.now,
                actor: self.actor.clone(),
                action: transition.action(),
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
    fn events(&self, outcome: &Outcome) -> Vec<NewEvent> {
        let source = match self.actor.authentication {
            Authentication::Service => EventSource::Service,
            Authentication::Zenoh => EventSource::Robot,
            // It may answer over HTTP as well.
            _ if self.actor.role == Some(Role::Robot) => EventSource::Robot,
            _ => EventSource::Person,
        };
        let event = |transition: &Transition| {
            let kind = history::kind_of(transition)?;
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
                // What the service did has no robot's time.
                stamp_ns: RobotTime(self.now.0),
                received_ns: self.now,
                source,
                author: (source == EventSource::Person).then(|| self.actor.name.clone()),
                note: transition.reason().map(str::to_owned),
                details: Some(serde_json::json!({
                    transition.action().subject(): transition.subject_id(),
                    "generation": generation,
                    "values": values,
                })),
            })
        };
        outcome.transitions.iter().filter_map(event).collect()
    }
}
