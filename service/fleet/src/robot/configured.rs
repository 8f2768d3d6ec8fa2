//! Result of configuring a robot.

use fleetcal_domain::robot::RobotConfig;
use fleetcal_estimator::EstimatorSettings;

/// Result of configuring a robot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Configured {
    /// The robot had no configuration.
    First,
    /// Its estimate continues.
    GoesOn,
    /// Its estimate begins from nothing, because of these keys.
    BeginsAgain(Vec<&'static str>),
}

impl Configured {
    /// Result of replacing a configuration by another one.
    pub fn by_change(former: &RobotConfig, new: &RobotConfig, own: &EstimatorSettings) -> Self {
        let keys = new.basis(own).differs_in(&former.basis(own));
        if keys.is_empty() {
            Self::GoesOn
        } else {
            Self::BeginsAgain(keys)
        }
    }
}
