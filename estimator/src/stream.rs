//! Events into and effects out of an estimator: the only types its users exchange with it.
//!
//! Each type is checked where it is made, so that nothing behind it has to check again.

pub use fleetcal_model::{NoteKind, RobotTime};
use fleetcal_odometry::field::{check_finite, check_stamp};
pub use fleetcal_odometry::{
    field::FieldRefused,
    scan::{BEAMS_MAX, Scan, ScanShape},
};
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use crate::estimate::{Change, Estimate};
use crate::geometry::Pose2;
use crate::lidar_odometry::OdometryPose;

/// Largest speed accepted from a drive sample, in m/s: beyond any warehouse vehicle.
pub const SPEED_MAX_MPS: f64 = 50.0;
/// Largest steering angle accepted from a drive sample, in rad: a steered wheel turns no further.
pub const STEERING_MAX_RAD: f64 = std::f64::consts::PI;

/// One drive sample. It describes the interval that ends at its stamp.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DriveSample {
    stamp: RobotTime,
    speed_mps: f64,
    steering_rad: f64,
}

impl DriveSample {
    /// A checked drive sample: measured speed (m/s, negative in reverse) and measured steering
    /// angle (rad, left positive).
    ///
    /// # Errors
    /// Names the field that is not finite, not of physical size, or not after 1970.
    pub fn new(stamp: RobotTime, speed_mps: f64, steering_rad: f64) -> Result<Self, FieldRefused> {
        check_stamp(stamp)?;
        check_finite("drive.speed", speed_mps, SPEED_MAX_MPS)?;
        check_finite("drive.steering_angle", steering_rad, STEERING_MAX_RAD)?;
        Ok(Self {
            stamp,
            speed_mps,
            steering_rad,
        })
    }

    /// End of the interval that the sample describes.
    pub fn stamp(&self) -> RobotTime {
        self.stamp
    }

    /// Measured speed, m/s.
    pub fn speed_mps(&self) -> f64 {
        self.speed_mps
    }

    /// Measured steering angle, rad, left positive.
    pub fn steering_rad(&self) -> f64 {
        self.steering_rad
    }
}

/// A pose of the LiDAR (or any other pose sensor) in its own odometry frame, made elsewhere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LidarPose {
    stamp: RobotTime,
    pose: Pose2,
    covariance: Option<Matrix3<f64>>,
}

impl LidarPose {
    /// A checked pose. `covariance` is of (x, y, yaw) in m and rad; `None` when the sender has none.
    ///
    /// # Errors
    /// Names the field that is not finite or the covariance that is not positive.
    pub fn new(
        stamp: RobotTime,
        pose: Pose2,
        covariance: Option<Matrix3<f64>>,
    ) -> Result<Self, FieldRefused> {
        check_stamp(stamp)?;
        check_finite("pose.position.x", pose.x_m, 1e7)?;
        check_finite("pose.position.y", pose.y_m, 1e7)?;
        check_finite("pose.orientation", pose.yaw_rad, 1e4)?;
        if let Some(matrix) = &covariance
            && matrix.cholesky().is_none()
        {
            return Err(FieldRefused::new(
                "pose.covariance",
                format!("{:?}", matrix.as_slice()),
                "a positive definite matrix, or zeros for none",
            ));
        }
        Ok(Self {
            stamp,
            pose,
            covariance,
        })
    }

    /// Time of the pose.
    pub fn stamp(&self) -> RobotTime {
        self.stamp
    }

    /// The sensor's pose in its odometry frame.
    pub fn pose(&self) -> Pose2 {
        self.pose
    }

    /// Covariance of (x, y, yaw) in the odometry frame, when the sender gave one.
    pub fn covariance(&self) -> Option<&Matrix3<f64>> {
        self.covariance.as_ref()
    }
}

/// A note in a robot's history.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Note {
    /// Time of the event, in message time.
    pub stamp: RobotTime,
    /// Kind of the event.
    pub kind: NoteKind,
}

/// Input of an estimator.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// Speed and steering.
    WheelOdometry(DriveSample),
    /// A raw scan.
    Scan(Scan),
    /// A pose instead of a scan.
    LidarPose(LidarPose),
    /// A note of a person or tool.
    Note(Note),
    /// End of the stream: the messages that the merger still holds are processed.
    EndOfSession,
}

/// Result of a step, for the world outside.
#[derive(Debug, Clone, PartialEq)]
pub enum Effect {
    /// A new estimate, at most one a second of message time.
    Estimate(Box<Estimate>),
    /// A change of the vehicle (or a sensor's fault).
    Change(Box<Change>),
    /// Amount of a change that was not known when it was published: the same change, under the same
    /// stamp, complete.
    ChangeSized(Box<Change>),
    /// A message that came too late, twice, or could not be used; it was counted.
    Dropped(Dropped),
    /// Result of LiDAR odometry for a scan, good or lost.
    LidarMoved(Box<OdometryPose>),
    /// A new session that begins with this stamp: the clock jumped back by more than 5 s.
    SessionStarted(RobotTime),
}

/// Reason for which the estimator left a message out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Dropped {
    /// Message older than those already processed.
    Late,
    /// Message with a stamp that its stream has had already.
    Duplicate,
    /// A scan without enough returns, or while the LiDAR odometry is lost.
    UnusableScan,
}
