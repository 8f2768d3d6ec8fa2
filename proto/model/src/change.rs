//! What happens to a vehicle: changes that the estimator detects, and notes of people and tools.

use serde::{Deserialize, Serialize};

/// What was seen to happen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum ChangeKind {
    /// The vehicle is no longer the one that was calibrated.
    CalibrationChanged,
    /// The parts were reported as reassembled and the comparison came out equal.
    CalibrationConfirmed,
    /// A sensor or the LiDAR odometry failed for a while.
    Fault,
}

/// What a change came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = ChangeCause))]
pub enum Cause {
    /// The steering zero moved.
    Steering,
    /// The LiDAR moved on the vehicle.
    LidarMount,
    /// Wheels or wheelbase changed.
    Vehicle,
    /// The LiDAR odometry failed.
    Odometry,
    /// The data do not tell.
    Unknown,
}

/// What happened to a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = RobotEventKind))]
pub enum NoteKind {
    /// Parts were taken off and put back: the calibration may have changed.
    Reassembled,
    /// Other work was done on the robot.
    Maintenance,
    /// The robot was switched on.
    PowerOn,
}
