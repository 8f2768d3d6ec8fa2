//! Alerts as the store keeps them.

use std::sync::Arc;

use fleetcal_domain::access::Actor;
use fleetcal_domain::alert::{Alert, AlertPolicy, ConditionName, Sighting, Subject};
use fleetcal_proto::RobotId;

/// A change of alerts, to be made in one transaction.
#[derive(Debug, Clone)]
pub enum AlertWrite {
    /// What the rules have seen.
    Observe {
        /// Of which robots, or of the fleet.
        sightings: Vec<(Subject, Sighting)>,
        /// How long something has to last.
        policy: Arc<AlertPolicy>,
        /// Wall time.
        now_ns: i64,
    },
    /// Somebody takes one on.
    Acknowledge(AcknowledgeWrite),
}

/// Somebody takes an alert on.
#[derive(Debug, Clone)]
pub struct AcknowledgeWrite {
    /// Which.
    pub id: u64,
    /// The version that was looked at.
    pub version: u64,
    /// Who.
    pub actor: Actor,
    /// What the person has to say.
    pub note: Option<String>,
    /// Wall time.
    pub now_ns: i64,
}

/// What became of one alert.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum AlertChange {
    /// It is new or has changed.
    Kept(Box<Alert>),
    /// It was pending, came to nothing, and is gone.
    Dropped(Box<Alert>),
}

/// One change of an alert.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AlertMoment {
    /// When, ns since 1970, wall time.
    pub at_ns: i64,
    /// The alert's version afterwards.
    pub version: u64,
    /// Where it stood afterwards.
    pub state: ConditionName,
    /// What was seen, in words.
    pub what: String,
    /// Who acknowledged; `None` for a change of the condition.
    pub by: Option<String>,
    /// What the person had to say.
    pub note: Option<String>,
}

/// Alerts in which conditions are asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AlertSelection {
    /// All that are not over.
    Active,
    /// In this one.
    In(ConditionName),
}

/// Which alerts are asked for.
#[derive(Debug, Clone, Default)]
pub struct AlertFilter {
    /// Of one robot.
    pub robot: Option<RobotId>,
    /// In which conditions; all unless given.
    pub selection: Option<AlertSelection>,
    /// After the alert of this rank and number.
    pub after: Option<(u32, i64)>,
    /// At most so many.
    pub limit: u32,
}
