//! Operations on records, drawn at random; every method of `Records` is in one of them.

use std::fmt::Write as _;

use async_trait::async_trait;
use fleetcal_cluster::{ClaimId, Duty, Epoch, Incarnation, InstanceId, Seat, Tenure};
use fleetcal_contract::config;
use fleetcal_domain::access::Actor;
use fleetcal_domain::approval::{Policy, ProposalAction};
use fleetcal_domain::audit::Action;
use fleetcal_model::WallTime;
use fleetcal_model::{AuditId, EventId, Generation, ProposalId, RobotTime, Version};
use fleetcal_store::transaction::AnswerScope;
use fleetcal_store::{
    AuditEntry, DeploymentFreeze, EventKind, EventSource, IdempotencyKey, Job, NewEvent, Records,
    StoreError, StoredPolicy,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::chance::{number, pick, robot, time, words};
use super::lifecycle::{advance, certificate, close, propose};
use super::methods::Calls;

mod access;
mod alerts;
mod rollouts;
mod webhooks;

/// Kind of an operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    AddUser,
    SaveUser,
    DeleteUser,
    AddSession,
    EndSessions,
    SetupCodes,
    AddToken,
    RevokeToken,
    AddAlert,
    SaveAlert,
    DeleteAlert,
    AnswerEvent,
    AnswerProposal,
    AnswerAccess,
    Propose,
    Close,
    Advance,
    Rollout,
    Freeze,
    SavePolicy,
    SaveConfig,
    AddWebhook,
    DeleteWebhook,
    AddDelivery,
    SaveDelivery,
    DropDeliveries,
    Audit,
}

impl Kind {
    pub const ALL: &'static [Self] = &[
        Self::AddUser,
        Self::SaveUser,
        Self::DeleteUser,
        Self::AddSession,
        Self::EndSessions,
        Self::SetupCodes,
        Self::AddToken,
        Self::RevokeToken,
        Self::AddAlert,
        Self::SaveAlert,
        Self::DeleteAlert,
        Self::AnswerEvent,
        Self::AnswerProposal,
        Self::AnswerAccess,
        // What others follow from comes more often.
        Self::Propose,
        Self::Propose,
        Self::Close,
        Self::Close,
        Self::Advance,
        Self::Rollout,
        Self::Freeze,
        Self::SavePolicy,
        Self::SaveConfig,
        Self::AddWebhook,
        Self::AddWebhook,
        Self::DeleteWebhook,
        Self::AddDelivery,
        Self::AddDelivery,
        Self::SaveDelivery,
        Self::DropDeliveries,
        Self::Audit,
    ];
}

/// One operation, which repeats exactly on the same records.
#[derive(Debug, Clone)]
pub struct Operation {
    pub kind: Kind,
    pub seed: u64,
    pub now: WallTime,
    pub calls: Calls,
}

/// Operation in progress: its random source, and the database's answers.
struct Run<'r> {
    records: &'r mut dyn Records,
    chance: ChaCha8Rng,
    now: WallTime,
    calls: &'r Calls,
    told: String,
}

/// Calls a method of the records, records the call, and keeps the answer.
macro_rules! ask {
    ($run:expr, $method:ident ( $($argument:expr),* )) => {{
        let answer = $run.records.$method($($argument),*).await?;
        $run.calls.note(concat!("records.", stringify!($method)));
        writeln!($run.told, concat!(stringify!($method), ": {:?}"), answer).unwrap();
        answer
    }};
}
use ask;

#[async_trait]
impl Job for Operation {
    type Done = String;

    async fn run(&self, records: &mut dyn Records) -> Result<String, StoreError> {
        let mut run = Run {
            records,
            chance: ChaCha8Rng::seed_from_u64(self.seed),
            now: self.now,
            calls: &self.calls,
            told: String::new(),
        };
        match self.kind {
            Kind::AddUser => run.add_user().await?,
            Kind::SaveUser => run.save_user().await?,
            Kind::DeleteUser => run.delete_user().await?,
            Kind::AddSession => run.add_session().await?,
            Kind::EndSessions => run.end_sessions().await?,
            Kind::SetupCodes => run.setup_codes().await?,
            Kind::AddToken => run.add_token().await?,
            Kind::RevokeToken => run.revoke_token().await?,
            Kind::AddAlert => run.add_alert().await?,
            Kind::SaveAlert => run.save_alert().await?,
            Kind::DeleteAlert => run.delete_alert().await?,
            Kind::AnswerEvent => run.answer_event().await?,
            Kind::AnswerProposal => run.answer_proposal().await?,
            Kind::AnswerAccess => run.answer_access().await?,
            Kind::Propose | Kind::Close | Kind::Advance => run.decide(self.kind).await?,
            Kind::Rollout => run.roll_out().await?,
            Kind::Freeze => run.freeze().await?,
            Kind::SavePolicy => run.save_policy().await?,
            Kind::SaveConfig => run.save_config().await?,
            Kind::AddWebhook => run.add_webhook().await?,
            Kind::DeleteWebhook => run.delete_webhook().await?,
            Kind::AddDelivery => run.add_delivery().await?,
            Kind::SaveDelivery => run.save_delivery().await?,
            Kind::DropDeliveries => run.drop_deliveries().await?,
            Kind::Audit => run.audit().await?,
        }
        Ok(run.told)
    }
}

impl Run<'_> {
    fn key(&mut self) -> IdempotencyKey {
        IdempotencyKey {
            key: format!("{}'", self.chance.random_range(0..20)),
            request_sha256: [self.chance.random(); 32],
        }
    }

    fn event(&mut self) -> NewEvent {
        let chance = &mut self.chance;
        let details = chance.random_bool(0.5);
        NewEvent {
            robot: robot(chance),
            kind: pick(chance, EventKind::ALL),
            stamp_ns: RobotTime(number(chance)),
            received_ns: time(chance),
            source: EventSource::Person,
            author: Some(words(chance)),
            note: Some(words(chance)),
            details: details.then(|| serde_json::json!({"said": words(chance)})),
        }
    }

    async fn answer_event(&mut self) -> Result<(), StoreError> {
        let (event, key, now) = (self.event(), self.key(), self.now);
        let scope = AnswerScope::Event(&event.robot);
        if ask!(self, answer(scope, &key.key)).is_none() {
            let id = ask!(self, add_event(&event));
            ask!(self, add_answer(scope, &key, id.0, now));
        }
        let id = EventId(self.chance.random_range(0..9));
        ask!(self, event(id));
        ask!(self, event(EventId(i64::MAX)));
        Ok(())
    }

    async fn answer_proposal(&mut self) -> Result<(), StoreError> {
        let (robot, key, now) = (robot(&mut self.chance), self.key(), self.now);
        let id = ProposalId(self.chance.random_range(0..6));
        let scope = AnswerScope::Proposal(&robot);
        let is_there = ask!(self, proposal(id)).is_some();
        if is_there && ask!(self, answer(scope, &key.key)).is_none() {
            ask!(self, add_answer(scope, &key, id.0 as i64, now));
        }
        ask!(self, proposal(ProposalId(u64::MAX)));
        Ok(())
    }

    async fn answer_access(&mut self) -> Result<(), StoreError> {
        let (key, now) = (self.key(), self.now);
        let scope = pick(&mut self.chance, &[AnswerScope::User, AnswerScope::Token]);
        if ask!(self, answer(scope, &key.key)).is_none() {
            ask!(self, add_answer(scope, &key, number(&mut self.chance), now));
        }
        Ok(())
    }

    async fn decide(&mut self, kind: Kind) -> Result<(), StoreError> {
        let robot = robot(&mut self.chance);
        let answered = Generation(self.chance.random_range(0..4));
        let answered = self.chance.random_bool(0.3).then_some(answered);
        let ledger = ask!(self, ledger(&robot, answered));
        let ids = ask!(self, next_ids());
        let seed = self.chance.random();
        let outcome = match kind {
            Kind::Propose => propose(ledger, ids, seed),
            Kind::Close => close(ledger, ids, seed),
            _ => advance(ledger, seed),
        };
        ask!(self, save_outcome(&outcome));
        if let Some(certificate) = certificate(&outcome, self.now) {
            ask!(self, save_certificate(&certificate));
        }
        ask!(self, ledger(&robot, None));
        Ok(())
    }

    async fn freeze(&mut self) -> Result<(), StoreError> {
        let before = ask!(self, deployment_freeze());
        let freeze = DeploymentFreeze {
            version: before.version.next(),
            frozen: self.chance.random(),
            by: Some(words(&mut self.chance)),
            at_ns: Some(WallTime(number(&mut self.chance))),
            reason: None,
        };
        ask!(self, save_deployment_freeze(&freeze));
        ask!(self, deployment_freeze());
        Ok(())
    }

    async fn save_policy(&mut self) -> Result<(), StoreError> {
        let before = ask!(self, stored_policy());
        let policy = StoredPolicy {
            version: before.version.next(),
            policy: self.chance.random_bool(0.5).then(Policy::default),
            by: Some(words(&mut self.chance)),
            at_ns: Some(self.now),
            reason: Some(words(&mut self.chance)),
        };
        ask!(self, save_policy(&policy));
        ask!(self, stored_policy());
        Ok(())
    }

    async fn save_config(&mut self) -> Result<(), StoreError> {
        let (id, now) = (robot(&mut self.chance), self.now);
        let before = ask!(self, robot(&id));
        let version = before.map_or(Version(0), |before| before.version).next();
        let config = config(self.chance.random_range(0.5..3.0));
        let by = words(&mut self.chance);
        let drawn_by = self.chance.random_bool(0.5).then_some(by.as_str());
        ask!(self, save_config(&id, &config, drawn_by, version, now));
        ask!(self, count_configured());
        ask!(self, robot(&id));
        Ok(())
    }

    async fn audit(&mut self) -> Result<(), StoreError> {
        let now = self.now;
        let chance = &mut self.chance;
        let id = robot(chance);
        let actors = [Actor::service(), Actor::command_line(), Actor::robot(&id)];
        let actions = [
            Action::NoteEvent,
            Action::SignIn,
            Action::Proposal(ProposalAction::Approve),
            Action::Proposal(ProposalAction::ApproveInPart),
        ];
        let entry = AuditEntry {
            at_ns: time(chance),
            actor: actors[chance.random_range(0..3)].clone(),
            action: pick(chance, &actions),
            subject_id: words(chance),
            robot: chance.random_bool(0.5).then_some(id),
            before: chance.random_bool(0.5).then(|| words(chance).into()),
            after: Some(serde_json::json!({"value": super::chance::real(chance)})),
            reason: Some(words(chance)),
        };
        ask!(self, append_audit(&entry));
        if let Some(robot) = &entry.robot {
            ask!(self, notes_after(robot, AuditId(1), 7));
        }
        ask!(self, prove_writable(now));
        // One service of a folder holds every tenure, and a server knows none here.
        self.records.holds_tenure(&tenure()).await?;
        self.calls.note("records.holds_tenure");
        self.records
            .holds_duty(&tenure().seat, Duty::Alerts)
            .await?;
        self.calls.note("records.holds_duty");
        Ok(())
    }
}

fn tenure() -> Tenure {
    Tenure {
        robot: fleetcal_contract::robot("a"),
        seat: Seat {
            instance: InstanceId::parse("here").unwrap(),
            incarnation: Incarnation(1),
        },
        epoch: Epoch(1),
        claim: ClaimId(1),
    }
}
