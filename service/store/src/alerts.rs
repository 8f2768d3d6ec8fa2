//! Alerts as the store keeps them.

use fleetcal_domain::alert::ConditionName;
use fleetcal_model::{Version, WallTime};
use fleetcal_proto::RobotId;

/// One change of an alert.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AlertMoment {
    /// When, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// The alert's version afterwards.
    pub version: Version,
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
