//! Changes of robots' configurations, and people's notes in robots' histories.

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use async_trait::async_trait;
use fleetcal_domain::access::{Actor, Authentication};
use fleetcal_domain::audit::Action;
use fleetcal_domain::limits;
use fleetcal_domain::robot::RobotConfig;
use fleetcal_model::{EventId, RobotId, Version, WallTime};
use fleetcal_store::transaction::AnswerScope;
use fleetcal_store::{
    AuditEntry, EventRecord, Expected, IdempotencyKey, Job, NewEvent, Records, RobotRecord, Store,
    StoreError,
};
use serde_json::Value;

use crate::Boxed;
use crate::answers::{made_before, note_made};

/// Stores a robot's configuration; returns its new version.
///
/// # Errors
/// [`StoreError::VersionConflict`] if it is not at the expected version, [`StoreError::RobotsMax`]
/// if it is new and the fleet is full; otherwise the database's failure.
pub fn configure(
    store: &Store,
    robot: &RobotId,
    config: &RobotConfig,
    expected: Expected,
    actor: Actor,
) -> Boxed<Result<Version, StoreError>> {
    let store = store.clone();
    let job = ConfigureRobot {
        robot: robot.clone(),
        config: config.clone(),
        expected,
        actor,
        now: store.now(),
    };
    Box::pin(async move { store.transact(job).await })
}

/// Stores the configurations of new robots, all or none.
///
/// # Errors
/// [`StoreError::VersionConflict`] if one of them has a configuration already,
/// [`StoreError::RobotsMax`] if the fleet has no room for all; otherwise the database's failure.
pub fn register_all(
    store: &Store,
    robots: &BTreeMap<RobotId, RobotConfig>,
    actor: &Actor,
) -> Boxed<Result<(), StoreError>> {
    let store = store.clone();
    let now = store.now();
    let each = robots.iter().map(|(robot, config)| ConfigureRobot {
        robot: robot.clone(),
        config: config.clone(),
        expected: Expected::Absent,
        actor: actor.clone(),
        now,
    });
    let job = RegisterRobots(each.collect());
    Box::pin(async move { store.transact(job).await })
}

/// Stores the note of a person or tool. With a key, a repeated request is answered with the same
/// event.
///
/// # Errors
/// [`StoreError::KeyReused`] if the key came with another request; otherwise the database's
/// failure.
pub fn note(
    store: &Store,
    event: NewEvent,
    actor: Actor,
    key: Option<IdempotencyKey>,
) -> Boxed<Result<EventRecord, StoreError>> {
    let store = store.clone();
    let job = NoteEvent { event, actor, key };
    Box::pin(async move { store.transact(job).await })
}

/// Job that stores a robot's configuration and returns its new version.
#[derive(Debug, Clone)]
pub struct ConfigureRobot {
    /// Robot of the configuration.
    pub robot: RobotId,
    /// New configuration.
    pub config: RobotConfig,
    /// Expected version.
    pub expected: Expected,
    /// Actor of the change.
    pub actor: Actor,
    /// Wall time.
    pub now: WallTime,
}

#[async_trait]
impl Job for ConfigureRobot {
    type Done = Version;

    async fn run(&self, records: &mut dyn Records) -> Result<Version, StoreError> {
        let version = self.write(records).await?;
        if version == Version(1) {
            check_robots(records).await?;
        }
        Ok(version)
    }
}

/// Refuses more robots than a fleet may have; what the job wrote is then undone.
async fn check_robots(records: &mut dyn Records) -> Result<(), StoreError> {
    let robots = records.count_configured().await? as usize;
    if robots > limits::ROBOTS_MAX {
        return Err(StoreError::RobotsMax { robots });
    }
    Ok(())
}

/// Job that stores the configurations of new robots in one transaction.
#[derive(Debug, Clone)]
struct RegisterRobots(Vec<ConfigureRobot>);

#[async_trait]
impl Job for RegisterRobots {
    type Done = ();

    async fn run(&self, records: &mut dyn Records) -> Result<(), StoreError> {
        for robot in &self.0 {
            robot.write(records).await?;
        }
        check_robots(records).await
    }
}

impl ConfigureRobot {
    /// Stores the configuration, however many robots there are.
    async fn write(&self, records: &mut dyn Records) -> Result<Version, StoreError> {
        let robot = records.robot(&self.robot).await?;
        let found = robot.as_ref().map_or(Version(0), |robot| robot.version);
        if !self.expected.accepts(found) {
            return Err(StoreError::VersionConflict {
                robot: self.robot.clone(),
                found,
            });
        }
        let version = found.next();
        let drawn_by = self.drawn_by(robot.as_ref());
        records
            .save_config(&self.robot, &self.config, drawn_by, version, self.now)
            .await?;
        let before = robot.and_then(|robot| robot.config);
        records.append_audit(&self.audit(before.as_ref())).await?;
        Ok(version)
    }

    /// Author of the drawing: the actor who changes it, or the author of an unchanged one.
    fn drawn_by<'a>(&'a self, before: Option<&'a RobotRecord>) -> Option<&'a str> {
        let drawing = self.config.nominal_extrinsics;
        let stood = before.and_then(|before| before.config.as_ref()?.nominal_extrinsics);
        if drawing == stood {
            return before.and_then(|before| before.drawn_by.as_deref());
        }
        // The service itself configures what its configuration file says.
        let by_person = self.actor.authentication != Authentication::Service;
        (drawing.is_some() && by_person).then_some(self.actor.name.as_str())
    }

    fn audit(&self, before: Option<&RobotConfig>) -> AuditEntry {
        AuditEntry {
            at_ns: self.now,
            actor: self.actor.clone(),
            action: match before {
                Some(_) => Action::ConfigureRobot,
                None => Action::RegisterRobot,
            },
            subject_id: self.robot.as_str().to_owned(),
            robot: Some(self.robot.clone()),
            before: before.map(document),
            after: Some(document(&self.config)),
            reason: None,
        }
    }
}

/// Record of a configuration for the audit; it holds finite numbers and text, which JSON can
/// represent.
fn document(config: &RobotConfig) -> Value {
    serde_json::to_value(config).unwrap_or(Value::Null)
}

/// Job that stores the note of a person or tool. With a key, a repeated request is answered with
/// the same event.
#[derive(Debug, Clone)]
pub struct NoteEvent {
    /// Event of the note.
    pub event: NewEvent,
    /// Author of the note.
    pub actor: Actor,
    /// Idempotency key of the request.
    pub key: Option<IdempotencyKey>,
}

#[async_trait]
impl Job for NoteEvent {
    type Done = EventRecord;

    async fn run(&self, records: &mut dyn Records) -> Result<EventRecord, StoreError> {
        let scope = AnswerScope::Event(&self.event.robot);
        let key = self.key.as_ref();
        if let Some(id) = made_before(records, scope, key).await?
            && let Some(record) = records.event(EventId(id)).await?
        {
            return Ok(EventRecord {
                repeated: true,
                ..record
            });
        }
        let id = records.add_event(&self.event).await?;
        note_made(records, scope, key, id.0, self.event.received_ns).await?;
        records.append_audit(&self.audit(id)).await?;
        Ok(EventRecord {
            id,
            repeated: false,
            event: self.event.clone(),
        })
    }
}

impl NoteEvent {
    fn audit(&self, id: EventId) -> AuditEntry {
        let event = &self.event;
        let after = serde_json::json!({
            "kind": event.kind.as_str(),
            "stamp_ns": event.stamp_ns,
            "note": event.note,
        });
        AuditEntry {
            at_ns: event.received_ns,
            actor: self.actor.clone(),
            action: Action::NoteEvent,
            subject_id: id.to_string(),
            robot: Some(event.robot.clone()),
            before: None,
            after: Some(after),
            reason: event.note.clone(),
        }
    }
}
