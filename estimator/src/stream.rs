//! Events into and effects out of an estimator: the only types its users exchange with it.
//!
//! Each type is checked where it is made, so that nothing behind it has to check again.

use std::sync::Arc;

pub use fleetcal_model::{NoteKind, RobotTime};
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::estimate::{Change, Estimate};
use crate::geometry::Pose2;

/// Largest number of beams a scan may have. Real planar scanners stay below 4096.
pub const BEAMS_MAX: usize = 16_384;
/// Largest speed accepted from a drive sample, in m/s: beyond any warehouse vehicle.
pub const SPEED_MAX_MPS: f64 = 50.0;
/// Largest steering angle accepted from a drive sample, in rad: a steered wheel turns no further.
pub const STEERING_MAX_RAD: f64 = std::f64::consts::PI;

/// Why a message was refused: the field, its value and what is accepted.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{field}: got {value}, expected {accepted}")]
pub struct FieldRefused {
    /// Name of the field, as it stands in the ROS message.
    pub field: &'static str,
    /// The value that was refused.
    pub value: String,
    /// What would have been accepted, in words.
    pub accepted: &'static str,
}

impl FieldRefused {
    pub(crate) fn new(
        field: &'static str,
        value: impl std::fmt::Display,
        accepted: &'static str,
    ) -> Self {
        Self {
            field,
            value: value.to_string(),
            accepted,
        }
    }
}

fn check_stamp(stamp: RobotTime) -> Result<(), FieldRefused> {
    if stamp.0 > 0 {
        Ok(())
    } else {
        Err(FieldRefused::new(
            "header.stamp",
            format!("{} ns", stamp.0),
            "a time after 1970",
        ))
    }
}

fn check_finite(field: &'static str, value: f64, limit: f64) -> Result<(), FieldRefused> {
    if value.is_finite() && value.abs() <= limit {
        Ok(())
    } else {
        Err(FieldRefused::new(
            field,
            value,
            "a finite number of physical size",
        ))
    }
}

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

/// The shape of a scan: everything of a `LaserScan` but its beams.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ScanShape {
    /// Direction of the first beam in the LiDAR's frame, rad.
    pub angle_min_rad: f64,
    /// Angle from one beam to the next, rad; negative for a scanner that turns clockwise.
    pub angle_increment_rad: f64,
    /// Time from one beam to the next, s; 0 when all were taken at once or corrected already, or when
    /// the scanner does not say: LiDAR odometry finds out which.
    pub time_increment_s: f64,
    /// Shortest valid range, m.
    pub range_min_m: f64,
    /// Longest valid range, m.
    pub range_max_m: f64,
}

/// One scan of a planar LiDAR, stamped at its first beam.
#[derive(Debug, Clone, PartialEq)]
pub struct Scan {
    stamp: RobotTime,
    shape: ScanShape,
    ranges_m: Arc<[f32]>,
    lacks_beam_times: bool,
}

impl Scan {
    /// A checked scan. Ranges that are not finite or lie outside `range_min..range_max` are no
    /// returns, which is normal input.
    ///
    /// # Errors
    /// Names the field of the shape that cannot be, or the number of beams.
    pub fn new(
        stamp: RobotTime,
        shape: ScanShape,
        ranges_m: Arc<[f32]>,
    ) -> Result<Self, FieldRefused> {
        check_stamp(stamp)?;
        check_finite("angle_min", shape.angle_min_rad, 10.0)?;
        check_finite("angle_increment", shape.angle_increment_rad, 1.0)?;
        if shape.angle_increment_rad == 0.0 {
            return Err(FieldRefused::new(
                "angle_increment",
                0.0,
                "a step other than zero",
            ));
        }
        if !(0.0..=1.0).contains(&shape.time_increment_s) {
            return Err(FieldRefused::new(
                "time_increment",
                shape.time_increment_s,
                "0 to 1 s",
            ));
        }
        if !(shape.range_min_m >= 0.0 && shape.range_min_m.is_finite()) {
            return Err(FieldRefused::new(
                "range_min",
                shape.range_min_m,
                "0 m or more",
            ));
        }
        if shape.range_max_m.is_nan() || shape.range_max_m <= shape.range_min_m {
            return Err(FieldRefused::new(
                "range_max",
                shape.range_max_m,
                "more than range_min",
            ));
        }
        if ranges_m.is_empty() || ranges_m.len() > BEAMS_MAX {
            return Err(FieldRefused::new(
                "ranges",
                ranges_m.len(),
                "1 to 16384 beams",
            ));
        }
        let span_rad = shape.angle_increment_rad.abs() * (ranges_m.len() - 1) as f64;
        if span_rad > std::f64::consts::TAU + 0.2 {
            return Err(FieldRefused::new(
                "angle_increment",
                span_rad,
                "at most one turn in all",
            ));
        }
        let duration_s = shape.time_increment_s * ranges_m.len() as f64;
        if duration_s > 2.0 {
            return Err(FieldRefused::new(
                "time_increment",
                duration_s,
                "a scan of at most 2 s",
            ));
        }
        Ok(Self {
            stamp,
            shape,
            ranges_m,
            lacks_beam_times: false,
        })
    }

    /// Marks a scan made of points without times: not even the order of its beams is known.
    #[must_use]
    pub fn without_beam_times(self) -> Self {
        Self {
            lacks_beam_times: true,
            ..self
        }
    }

    /// Says whether it was made of points without times.
    pub fn lacks_beam_times(&self) -> bool {
        self.lacks_beam_times
    }

    /// Time of the first beam.
    pub fn stamp(&self) -> RobotTime {
        self.stamp
    }

    /// The scan's shape.
    pub fn shape(&self) -> &ScanShape {
        &self.shape
    }

    /// Ranges, m, one a beam.
    pub fn ranges_m(&self) -> &[f32] {
        &self.ranges_m
    }

    /// The scan's reference time: its middle. Poses of a scan are poses at this time.
    pub fn reference_stamp(&self) -> RobotTime {
        self.middle_stamp(self.shape.time_increment_s)
    }

    /// Its middle when its beams follow each other after `time_increment_s`.
    pub(crate) fn middle_stamp(&self, time_increment_s: f64) -> RobotTime {
        let half_s = 0.5 * (self.ranges_m.len() - 1) as f64 * time_increment_s;
        self.stamp.plus_seconds(half_s)
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
    /// When it happened, in message time.
    pub stamp: RobotTime,
    /// What happened.
    pub kind: NoteKind,
}

/// Everything that can wake an estimator.
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
    /// The stream ends here: what the merger still holds is worked through.
    EndOfSession,
}

/// What the world outside has to do after a step.
#[derive(Debug, Clone, PartialEq)]
pub enum Effect {
    /// A new estimate, at most one a second of message time.
    Estimate(Box<Estimate>),
    /// Something changed on the vehicle (or a sensor's fault was seen).
    Change(Box<Change>),
    /// How far a change went whose amount was not known when it was told: the same change, under
    /// the same stamp, complete.
    ChangeSized(Box<Change>),
    /// A message came too late, twice, or could not be used; it was counted.
    Dropped(Dropped),
    /// The clock jumped back by more than 5 s: a new session begins with this stamp.
    SessionStarted(RobotTime),
}

/// Why the estimator left a message out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Dropped {
    /// Older than what was already worked through.
    Late,
    /// The same stamp of the same stream again.
    Duplicate,
    /// A scan without enough returns, or while the LiDAR odometry is lost.
    UnusableScan,
}
