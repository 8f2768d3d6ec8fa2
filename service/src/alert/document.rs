//! An alert as people and programs are given it: over HTTP, on the event stream and in webhooks.

use fleetcal_proto::RobotId;
use jiff::Timestamp;
use serde::Serialize;

use super::condition::ConditionName;
use super::kind::{AlertKind, Severity};
use super::record::Alert;

/// Something that is or was wrong with one robot. Its `ETag` is `version`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, utoipa::ToSchema)]
#[schema(as = Alert)]
pub struct AlertDocument {
    /// Its number.
    pub id: u64,
    /// Whose.
    pub robot: RobotId,
    /// What is wrong.
    pub kind: AlertKind,
    /// How bad that is.
    pub severity: Severity,
    /// Where it stands.
    pub state: ConditionName,
    /// Since when it stands there.
    #[schema(value_type = String, format = DateTime)]
    pub since: Timestamp,
    /// Goes up with every change of it.
    pub version: u64,
    /// What was seen when it last began to fire, in words.
    pub what: String,
    /// What to do about it, in words.
    pub advice: &'static str,
    /// When it was first seen.
    #[schema(value_type = String, format = DateTime)]
    pub began: Timestamp,
    /// When it first alerted; `null` while it is pending.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub alerted: Option<Timestamp>,
    /// When it was over; `null` while it is active.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub ended: Option<Timestamp>,
    /// Who has taken it on; `null` while nobody has.
    pub acknowledgement: Option<AcknowledgementDocument>,
}

/// Who has taken an alert on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, utoipa::ToSchema)]
#[schema(as = Acknowledgement)]
pub struct AcknowledgementDocument {
    /// Who.
    pub by: String,
    /// When.
    #[schema(value_type = String, format = DateTime)]
    pub at: Timestamp,
    /// What the person has to say.
    pub note: Option<String>,
}

impl AlertDocument {
    /// The document of an alert.
    pub fn of(alert: &Alert) -> Self {
        let acknowledgement = alert.acknowledgement.as_ref();
        Self {
            id: alert.id,
            robot: alert.robot.clone(),
            kind: alert.kind,
            severity: alert.kind.severity(),
            state: alert.condition.name(),
            since: time(alert.condition.since_ns()),
            version: alert.version,
            what: alert.what.clone(),
            advice: alert.kind.advice(),
            began: time(alert.began_ns),
            alerted: alert.alerted_ns.map(time),
            ended: alert.ended_ns.map(time),
            acknowledgement: acknowledgement.map(|one| AcknowledgementDocument {
                by: one.by.clone(),
                at: time(one.at_ns),
                note: one.note.clone(),
            }),
        }
    }
}

fn time(ns: i64) -> Timestamp {
    // Every such number is a year between 1677 and 2262, all of which a time can hold.
    Timestamp::from_nanosecond(i128::from(ns)).unwrap_or(Timestamp::UNIX_EPOCH)
}
