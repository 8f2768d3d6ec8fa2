//! Configuration of a calibrator.

use serde::{Deserialize, Serialize};

use crate::geometry::Pose2;
use crate::settings::EstimatorSettings;
use crate::vehicle::Vehicle;

/// Knowledge of a robot before it has driven.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CalibratorConfig {
    /// The vehicle.
    pub vehicle: Vehicle,
    /// The LiDAR's pose in `base` from CAD or tape, when there is one.
    pub nominal_lidar_in_base: Option<Pose2>,
    /// Settings of the filter.
    pub settings: EstimatorSettings,
}

impl CalibratorConfig {
    /// A configuration with default settings and no nominal mount.
    pub fn of(vehicle: Vehicle) -> Self {
        Self {
            vehicle,
            nominal_lidar_in_base: None,
            settings: EstimatorSettings::default(),
        }
    }
}
