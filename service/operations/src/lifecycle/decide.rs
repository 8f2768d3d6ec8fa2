//! Decision on one robot's records: they are loaded, the pure [`step`] is applied, and its outcome
//! is saved with its audit, its history and its messages, in one transaction.

use std::collections::BTreeMap;
use std::sync::Arc;

use async_trait::async_trait;
use fleetcal_cluster::Tenure;
use fleetcal_domain::access::{AccountName, Actor, Authentication, Role};
use fleetcal_domain::alert::{AlertKind, StoredAlert, Subject};
use fleetcal_domain::approval::{
    Command, Drawing, Outcome, Policy, Present, Proposal, Refused, Standing, Transition, audited,
    automatic, nominal_values, step,
};
use fleetcal_domain::limits;
use fleetcal_domain::robot::{CrossTrack, RobotView};
use fleetcal_domain::standing::{self, RobotAlerts, StandingBasis};
use fleetcal_domain::webhook::Message;
use fleetcal_model::{Generation, NoteKind, Pose2, ProposalId, RobotTime, RolloutId, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::signing::SigningKey;
use fleetcal_rollout::RolloutRefused;
use fleetcal_store::transaction::AnswerScope;
use fleetcal_store::{
    AuditEntry, EventKind, EventSource, IdempotencyKey, Job, NewEvent, Records, RobotRecord,
    StoreError,
};

use super::history;
use crate::answers::{made_before, note_made};
use crate::notes;
use crate::webhook_dispatcher::outbox;

/// Command on one robot's records, to be applied in one transaction.
#[derive(Debug, Clone)]
pub struct Decide {
    /// Robot of the records.
    pub robot: RobotId,
    /// Command to apply.
    pub command: Command,
    /// Originator of the command.
    pub actor: Actor,
    /// Tenure of the service's own decision, in a cluster: it must not have ended.
    pub tenure: Option<Tenure>,
    /// Policy of the configuration file, in force unless another one was set.
    pub given_policy: Arc<Policy>,
    /// Key that signs documents.
    pub key: Arc<SigningKey>,
    /// Wall time.
    pub now: WallTime,
    /// Idempotency key of the request, by which a repetition is recognised.
    pub idempotency: Option<IdempotencyKey>,
    /// Pose of the rear axle in the robot's `base_link`, if configured.
    pub rear_axle_in_base_link: Option<Pose2>,
    /// Present estimate of the robot.
    pub present: Present,
    /// View of the robot at this moment; `None` for one that the fleet lacks.
    pub view: Option<Box<RobotView>>,
    /// Cross-track errors of the robot, by generation.
    pub cross_tracks: BTreeMap<Generation, CrossTrack>,
    /// Roll-out that releases the approval; `None` for a decision at this moment.
    pub release: Option<Release>,
}

/// Wave of a roll-out that releases an approval.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Release {
    /// Number of the roll-out.
    pub rollout: RolloutId,
    /// Number of the wave, from 1.
    pub wave: u32,
}

/// Result of a decision.
#[derive(Debug, Clone)]
pub enum Decided {
    /// Committed decision.
    Taken(Box<Outcome>),
    /// Proposal of the same request, which was answered before.
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
        self.check_release(records).await?;
        if let Some(proposal) = self.answered(records).await? {
            return Ok(Decided::Repeated(Box::new(proposal)));
        }
        let policy = records.stored_policy().await?.policy;
        let policy = policy.unwrap_or(*self.given_policy);
        let outcome = self.step(records, &policy).await?;
        records.save_outcome(&outcome).await?;
        if let Some(certificate) = self.certificate(records, &outcome).await? {
            records.save_certificate(&certificate).await?;
        }
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
    /// Refuses an approval that its roll-out does not release now, or whose approver's account does
    /// not permit it any more.
    async fn check_release(&self, records: &mut dyn Records) -> Result<(), StoreError> {
        let Some(Release { rollout, wave }) = self.release else {
            return Ok(());
        };
        let found = records.rollout(rollout).await?;
        let found = found.ok_or(RolloutRefused::Unknown(rollout))?;
        let name = AccountName::parse(&found.approver.name);
        let account = match (name, found.approver.authentication) {
            (Ok(name), Authentication::Session) => {
                let user = records.user_named(&name).await?;
                let user = user.filter(|user| !user.disabled);
                user.map(|user| (user.grant, user.created_ns))
            }
            (Ok(name), Authentication::Token) => {
                let token = records.token_named(&name, self.now).await?;
                token.map(|token| (token.grant, token.span.created_ns))
            }
            _ => None,
        };
        let account = account
            .as_ref()
            .map(|(grant, created_ns)| (grant, *created_ns));
        Ok(found.may_release(wave, account)?)
    }

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
            is_sending: self
                .view
                .as_ref()
                .is_some_and(|view| !view.connection.stale),
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

    /// Present estimate. The latest one may be older than a reassembly that is reported already:
    /// then it is unknown.
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

    /// Proposal with which the same request was answered before.
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

    /// Adds messages about open proposals to the outbox of webhooks.
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

/// Configured drawing of a robot, with its author.
fn drawing(robot: RobotRecord) -> Option<Drawing> {
    let mount = robot.config?.nominal_extrinsics?;
    Some(Drawing {
        values: nominal_values(&mount.pose()),
        by: robot.drawn_by,
    })
}

impl Decide {
    /// Standing of the robot with an outcome.
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
                let stored = records.active_alert(&subject, kind).await?;
                active.extend(stored.and_then(StoredAlert::known));
            }
        }
        let mut alerts = RobotAlerts::by_robot(&active);
        let alerts = alerts.remove(&self.robot).unwrap_or_default();
        let basis = StandingBasis::of(view, &outcome.ledger, &policy.propose_beyond);
        Ok(Some(basis.with(&alerts)))
    }

    /// Rows of the audit for an outcome.
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

    /// Entries of the robot's history for an outcome.
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
