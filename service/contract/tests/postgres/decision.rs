//! A decision as people make them: an event, an audit row, and the answer to its `Idempotency-Key`.

use async_trait::async_trait;
use fleetcal_contract::{NOW_S, NS, event, robot};
use fleetcal_domain::access::Actor;
use fleetcal_domain::audit::Action;
use fleetcal_model::{EventId, WallTime};
use fleetcal_store::transaction::AnswerScope;
use fleetcal_store::{
    AuditEntry, AuditFilter, IdempotencyKey, Job, NewEvent, Records, Store, StoreError,
};

/// Time of all decisions, recent enough that their answers are still kept.
const NOW: WallTime = WallTime(NOW_S * NS);
/// More rows than a test writes.
const MANY: u32 = 1_000_000;

/// Job that records an event once for its key.
#[derive(Debug, Clone)]
pub struct Decide(pub String);

#[async_trait]
impl Job for Decide {
    type Done = EventId;

    async fn run(&self, records: &mut dyn Records) -> Result<EventId, StoreError> {
        let robot = robot("a");
        let scope = AnswerScope::Event(&robot);
        if let Some(answer) = records.answer(scope, &self.0).await? {
            return Ok(EventId(answer.made));
        }
        let id = records.add_event(&self.event()).await?;
        let key = IdempotencyKey {
            key: self.0.clone(),
            request_sha256: [7; 32],
        };
        records.append_audit(&self.audit(id)).await?;
        records.add_answer(scope, &key, id.0, NOW).await?;
        Ok(id)
    }
}

impl Decide {
    fn event(&self) -> NewEvent {
        event(&self.0)
    }

    fn audit(&self, id: EventId) -> AuditEntry {
        AuditEntry {
            at_ns: NOW,
            actor: Actor::service(),
            action: Action::NoteEvent,
            subject_id: id.to_string(),
            robot: Some(robot("a")),
            before: None,
            after: None,
            reason: Some(self.0.clone()),
        }
    }
}

/// Job that reads the stored answer of a key.
#[derive(Debug)]
struct AnswerOf(String);

#[async_trait]
impl Job for AnswerOf {
    type Done = Option<i64>;

    async fn run(&self, records: &mut dyn Records) -> Result<Option<i64>, StoreError> {
        let robot = robot("a");
        let answer = records.answer(AnswerScope::Event(&robot), &self.0).await?;
        Ok(answer.map(|answer| answer.made))
    }
}

/// Returns the number of records of each decision: its event, its audit row and its answer have to
/// agree.
pub async fn times_decided(store: &Store, decisions: &[Decide]) -> Vec<usize> {
    let events = store.events(&robot("a"), None, MANY).await.unwrap();
    let filter = AuditFilter {
        limit: MANY,
        ..AuditFilter::default()
    };
    let audit = store.audit(&filter).await.unwrap();
    let mut times = Vec::new();
    for decision in decisions {
        let noted = events.iter();
        let noted: Vec<i64> = noted
            .filter(|record| record.event.note.as_deref() == Some(decision.0.as_str()))
            .map(|record| record.id.0)
            .collect();
        let audited = audit.iter();
        let audited = audited.filter(|row| row.reason.as_deref() == Some(decision.0.as_str()));
        let audited: Vec<_> = audited.map(|row| row.subject_id.clone()).collect();
        let named: Vec<_> = noted.iter().map(ToString::to_string).collect();
        assert_eq!(audited, named, "half of {decision:?} is there");
        let answer = store.transact(AnswerOf(decision.0.clone())).await.unwrap();
        assert_eq!(answer.as_slice(), noted, "half of {decision:?} is there");
        times.push(noted.len());
    }
    times
}
