//! Document of an alert: over HTTP, on the event stream and in webhooks.

use fleetcal_model::{AlertId, Version};
use fleetcal_proto::RobotId;
use jiff::Timestamp;
use serde::Serialize;

use super::condition::ConditionName;
use super::kind::{AlertKind, Severity};
use super::record::{Acknowledgement, Alert};
use super::stored::{Named, NewerAlert, StoredAlert};
use crate::timestamp;

/// Advice for an alert of a newer version.
const NEWER_ADVICE: &str = "This version of fleetcal does not know this alert: a newer one that \
                            shares the database raised it. Finish the upgrade, or look at an \
                            instance of the newer version.";

/// Present or past problem of a robot. Its `ETag` is `version`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = Alert))]
pub struct AlertDocument {
    /// Number of the alert.
    pub id: AlertId,
    /// Robot; `null` for an alert about several robots.
    pub robot: Option<RobotId>,
    /// Robots of an alert about several; empty otherwise.
    pub robots: Vec<RobotId>,
    /// Kind of problem; for one that a newer version of the service has stored, its name there.
    #[cfg_attr(feature = "openapi", schema(value_type = AlertKind))]
    pub kind: Named<AlertKind>,
    /// Severity of the problem.
    pub severity: Severity,
    /// Condition of the alert; for one that a newer version has stored, its name there.
    #[cfg_attr(feature = "openapi", schema(value_type = ConditionName))]
    pub state: Named<ConditionName>,
    /// Begin of that condition.
    #[cfg_attr(feature = "openapi", schema(value_type = String, format = DateTime))]
    pub since: Timestamp,
    /// Version, incremented with every change.
    pub version: Version,
    /// Description of the observation, at most some seconds old; of an alert that no longer fires,
    /// the last one, marked as past.
    pub what: String,
    /// Advice for the person who looks after the alert.
    pub advice: &'static str,
    /// Time of the first observation.
    #[cfg_attr(feature = "openapi", schema(value_type = String, format = DateTime))]
    pub began: Timestamp,
    /// Time at which it first alerted; `null` while it is pending.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = DateTime))]
    pub alerted: Option<Timestamp>,
    /// Time at which it ended; `null` while it is active.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = DateTime))]
    pub ended: Option<Timestamp>,
    /// Acknowledgement; `null` before there is one.
    pub acknowledgement: Option<AcknowledgementDocument>,
}

/// Acknowledgement of an alert.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = Acknowledgement))]
pub struct AcknowledgementDocument {
    /// Person or tool that acknowledged it.
    pub by: String,
    /// Time of the acknowledgement.
    #[cfg_attr(feature = "openapi", schema(value_type = String, format = DateTime))]
    pub at: Timestamp,
    /// Note of the person.
    pub note: Option<String>,
}

impl AlertDocument {
    /// Document of an alert.
    pub fn of(alert: &Alert) -> Self {
        Self {
            id: alert.id,
            robot: alert.robot.robot().cloned(),
            robots: alert.robots.clone(),
            kind: alert.kind.into(),
            severity: alert.kind.severity(),
            state: alert.condition.name().into(),
            since: timestamp::of(alert.condition.since()),
            version: alert.version,
            what: words(alert),
            advice: alert.kind.advice(),
            began: timestamp::of(alert.began_ns),
            alerted: alert.alerted_ns.map(timestamp::of),
            ended: alert.ended_ns.map(timestamp::of),
            acknowledgement: alert.acknowledgement.as_ref().map(acknowledged),
        }
    }

    /// Document of an alert in the database.
    pub fn of_stored(stored: &StoredAlert) -> Self {
        match stored {
            StoredAlert::Known(alert) => Self::of(alert),
            StoredAlert::Newer(newer) => Self::of_newer(newer),
        }
    }

    fn of_newer(newer: &NewerAlert) -> Self {
        let kind = Named::kind(&newer.kind);
        Self {
            id: newer.id,
            robot: newer.robot.robot().cloned(),
            robots: newer.robots.clone(),
            severity: match kind {
                Named::Known(kind) => kind.severity(),
                Named::Newer(_) => Severity::Warning,
            },
            kind,
            state: Named::condition(&newer.condition.state),
            since: timestamp::of(newer.condition.since_ns),
            version: newer.version,
            what: newer.what.clone(),
            advice: NEWER_ADVICE,
            began: timestamp::of(newer.began_ns),
            alerted: newer.alerted_ns.map(timestamp::of),
            ended: newer.ended_ns.map(timestamp::of),
            acknowledgement: newer.acknowledgement.as_ref().map(acknowledged),
        }
    }
}

fn acknowledged(one: &Acknowledgement) -> AcknowledgementDocument {
    AcknowledgementDocument {
        by: one.by.clone(),
        at: timestamp::of(one.at_ns),
        note: one.note.clone(),
    }
}

/// Description of the alert as of now: the present observation while it fires, and else the last
/// one, marked as past.
fn words(alert: &Alert) -> String {
    let what = &alert.what;
    match alert.condition.name() {
        ConditionName::Pending | ConditionName::Alerting => what.clone(),
        ConditionName::Recovering => format!("not seen any more: {what}"),
        ConditionName::NoData => format!("at the robot's last message: {what}"),
        ConditionName::Normal => format!("over; it was: {what}"),
    }
}
