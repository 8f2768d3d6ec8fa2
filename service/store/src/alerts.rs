//! Alerts in the store.

use fleetcal_domain::alert::{ConditionName, Named};
use fleetcal_model::{Version, WallTime};
use fleetcal_proto::RobotId;

/// Change of an alert.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AlertMoment {
    /// Time of the change, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// The alert's version afterwards.
    pub version: Version,
    /// Condition of the alert afterwards.
    pub state: Named<ConditionName>,
    /// Description of the observation.
    pub what: String,
    /// Person or tool that acknowledged it; `None` for a change of the condition.
    pub by: Option<String>,
    /// Note of the person.
    pub note: Option<String>,
}

/// Selection of alerts by their condition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AlertSelection {
    /// Alerts that have not ended.
    Active,
    /// Alerts in this condition.
    In(ConditionName),
}

/// Filter of alerts.
#[derive(Debug, Clone, Default)]
pub struct AlertFilter {
    /// Robot of the alerts.
    pub robot: Option<RobotId>,
    /// Conditions of the alerts; all unless given.
    pub selection: Option<AlertSelection>,
    /// Rank and number that the alerts come after.
    pub after: Option<(u32, i64)>,
    /// Largest number of alerts.
    pub limit: u32,
}
