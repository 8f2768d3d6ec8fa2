//! An alert as people and programs are given it: over HTTP, on the event stream and in webhooks.

use fleetcal_model::{AlertId, Version};
use fleetcal_proto::RobotId;
use jiff::Timestamp;
use serde::Serialize;

use super::condition::ConditionName;
use super::kind::{AlertKind, Severity};
use super::record::Alert;
use crate::timestamp;

/// Something that is or was wrong with one robot. Its `ETag` is `version`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = Alert))]
pub struct AlertDocument {
    /// Its number.
    pub id: AlertId,
    /// Whose; `null` of an alert that is about several robots.
    pub robot: Option<RobotId>,
    /// The robots of an alert that is about several; empty otherwise.
    pub robots: Vec<RobotId>,
    /// What is wrong.
    pub kind: AlertKind,
    /// How bad that is.
    pub severity: Severity,
    /// Where it stands.
    pub state: ConditionName,
    /// Since when it stands there.
    #[cfg_attr(feature = "openapi", schema(value_type = String, format = DateTime))]
    pub since: Timestamp,
    /// Goes up with every change of it.
    pub version: Version,
    /// What is seen, in words, not older than some seconds; of an alert that no longer fires, what
    /// was seen last, and that it is not seen any more.
    pub what: String,
    /// What to do about it, in words.
    pub advice: &'static str,
    /// When it was first seen.
    #[cfg_attr(feature = "openapi", schema(value_type = String, format = DateTime))]
    pub began: Timestamp,
    /// When it first alerted; `null` while it is pending.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = DateTime))]
    pub alerted: Option<Timestamp>,
    /// When it was over; `null` while it is active.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = DateTime))]
    pub ended: Option<Timestamp>,
    /// Who has taken it on; `null` while nobody has.
    pub acknowledgement: Option<AcknowledgementDocument>,
}

/// Who has taken an alert on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = Acknowledgement))]
pub struct AcknowledgementDocument {
    /// Who.
    pub by: String,
    /// When.
    #[cfg_attr(feature = "openapi", schema(value_type = String, format = DateTime))]
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
            robot: alert.robot.robot().cloned(),
            robots: alert.robots.clone(),
            kind: alert.kind,
            severity: alert.kind.severity(),
            state: alert.condition.name(),
            since: timestamp::of(alert.condition.since()),
            version: alert.version,
            what: words(alert),
            advice: alert.kind.advice(),
            began: timestamp::of(alert.began_ns),
            alerted: alert.alerted_ns.map(timestamp::of),
            ended: alert.ended_ns.map(timestamp::of),
            acknowledgement: acknowledgement.map(|one| AcknowledgementDocument {
                by: one.by.clone(),
                at: timestamp::of(one.at_ns),
                note: one.note.clone(),
            }),
        }
    }
}

/// What is so now: what an alert says as long as it fires, and else what was so.
fn words(alert: &Alert) -> String {
    let what = &alert.what;
    match alert.condition.name() {
        ConditionName::Pending | ConditionName::Alerting => what.clone(),
        ConditionName::Recovering => format!("not seen any more: {what}"),
        ConditionName::NoData => format!("when the robot was last heard: {what}"),
        ConditionName::Normal => format!("over; it was: {what}"),
    }
}
