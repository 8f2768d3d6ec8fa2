//! Changes of a vehicle that the estimator detects, and notes of people and tools.

use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;

/// Kind of a detected change or fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum ChangeKind {
    /// The vehicle is no longer the one that was calibrated.
    CalibrationChanged,
    /// The parts were reported as reassembled and the comparison came out equal.
    CalibrationConfirmed,
    /// The parts were reported as reassembled, and the calibration is known for the first time, so
    /// that there was nothing to compare it with.
    CalibrationLearned,
    /// A sensor or the LiDAR odometry failed for a while.
    Fault,
}

/// Cause of a change.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, IntoStaticStr, Serialize, Deserialize,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
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
    /// The data do not distinguish the causes.
    Unknown,
}

/// State of the detection of changes with one cause: watching, or the missing condition.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, IntoStaticStr, Serialize, Deserialize,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum DetectionState {
    /// A change would be detected within some metres.
    Watching,
    /// The estimator has not begun, or a new session has not been compared with the stored
    /// calibration yet.
    FirstEstimate,
    /// The parameters are not known well enough for a comparison.
    Accuracy,
    /// Intermittent errors of this robot are as large as the changes that matter.
    Scatter,
    /// The robot has not driven or turned enough to judge, or to show a change.
    Motion,
    /// A fault lasts, during which nothing can be judged.
    Fault,
}

/// Changes that would be detected now, by their causes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Detection {
    /// A jump of the steering zero.
    pub steering: DetectionState,
    /// A LiDAR that was moved or turned.
    pub lidar_mount: DetectionState,
    /// A new speed scale: other wheels.
    pub vehicle: DetectionState,
}

impl Detection {
    /// Returns the state of each cause that can be distinguished.
    pub const fn of_causes(&self) -> [(Cause, DetectionState); 3] {
        [
            (Cause::Steering, self.steering),
            (Cause::LidarMount, self.lidar_mount),
            (Cause::Vehicle, self.vehicle),
        ]
    }

    /// Makes the detection with one state for all causes.
    pub const fn of_all(state: DetectionState) -> Self {
        Self {
            steering: state,
            lidar_mount: state,
            vehicle: state,
        }
    }
}

/// Kind of an event that a note reports.
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
