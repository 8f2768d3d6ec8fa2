//! Changes of a vehicle that the estimator detects, and notes of people and tools.

use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;

/// What was seen to happen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum ChangeKind {
    /// The vehicle is no longer the one that was calibrated.
    CalibrationChanged,
    /// The parts were reported as reassembled and the comparison came out equal.
    CalibrationConfirmed,
    /// The parts were reported as reassembled, and the calibration is known for the first time: there was
    /// nothing to compare it with.
    CalibrationLearned,
    /// A sensor or the LiDAR odometry failed for a while.
    Fault,
}

/// What a change came from.
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
    /// The data do not tell.
    Unknown,
}

/// Whether a change of one cause would be seen now, and what its detection waits for if not.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, IntoStaticStr, Serialize, Deserialize,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum DetectionState {
    /// A change would be seen within some metres.
    Watching,
    /// The estimator has not begun, or a new session has not been held against the stored
    /// calibration yet.
    FirstEstimate,
    /// The parameters are not known well enough to be held against.
    Accuracy,
    /// Errors of this robot that come and go are as large as the changes that matter.
    Scatter,
    /// The robot has not driven or turned enough to tell, or to show a change.
    Motion,
    /// A fault lasts, in which nothing can be told.
    Fault,
}

/// Which changes would be seen now, by what they come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Detection {
    /// A jump of the steering zero.
    pub steering: DetectionState,
    /// A LiDAR that was moved or turned.
    pub lidar_mount: DetectionState,
    /// Another speed scale: other wheels.
    pub vehicle: DetectionState,
}

impl Detection {
    /// The state of each cause that is told apart.
    pub const fn of_causes(&self) -> [(Cause, DetectionState); 3] {
        [
            (Cause::Steering, self.steering),
            (Cause::LidarMount, self.lidar_mount),
            (Cause::Vehicle, self.vehicle),
        ]
    }

    /// The same for all.
    pub const fn of_all(state: DetectionState) -> Self {
        Self {
            steering: state,
            lidar_mount: state,
            vehicle: state,
        }
    }
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
