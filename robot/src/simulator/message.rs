//! Messages of the simulator: plain numbers, ready for any wire.

use serde::{Deserialize, Serialize};

use super::plane::Pose2;

/// Measured speed and steering of the interval that ends at the stamp.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DriveSample {
    /// End of the interval on the wheel odometry's clock, ns.
    pub stamp_ns: i64,
    /// Measured speed, m/s, at the place where the vehicle measures it.
    pub speed_mps: f64,
    /// Measured steering angle, rad, left positive: raw, with its offset.
    pub steering_rad: f64,
}

/// One scan of the LiDAR, stamped at its first beam.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scan {
    /// Time of the first beam, ns.
    pub stamp_ns: i64,
    /// Direction of the first beam in the LiDAR's frame, rad.
    pub angle_min_rad: f64,
    /// Angle from one beam to the next, rad; negative for a clockwise scanner.
    pub angle_increment_rad: f64,
    /// Time from one beam to the next, s; 0 for simultaneous beams.
    pub time_increment_s: f64,
    /// Time from one scan to the next, s.
    pub scan_time_s: f64,
    /// Shortest range, m.
    pub range_min_m: f64,
    /// Longest range, m.
    pub range_max_m: f64,
    /// Ranges, m, one a beam; infinite for a missing return.
    pub ranges_m: Vec<f32>,
}

/// The LiDAR's pose in its own odometry frame, in place of a scan.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LidarPose {
    /// Time of the pose, ns.
    pub stamp_ns: i64,
    /// Pose of the LiDAR in the frame of its first pose.
    pub pose: Pose2,
    /// Covariance of (x, y, yaw), m and rad, of the noise of one scan; `None` without noise.
    pub covariance: Option<[[f64; 3]; 3]>,
}

/// Robot's own estimate of its distance from its path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CrossTrackError {
    /// Time, ns.
    pub stamp_ns: i64,
    /// Distance to the left of the path, m.
    pub value_m: f64,
}

/// A message of the robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum SimulatedMessage {
    /// Speed and steering.
    WheelOdometry(DriveSample),
    /// A scan.
    Scan(Scan),
    /// A pose instead of a scan.
    LidarPose(LidarPose),
    /// Cross-track error, once a second.
    CrossTrackError(CrossTrackError),
}

impl SimulatedMessage {
    /// Returns the message's own stamp, ns.
    pub const fn stamp_ns(&self) -> i64 {
        match self {
            Self::WheelOdometry(drive) => drive.stamp_ns,
            Self::Scan(scan) => scan.stamp_ns,
            Self::LidarPose(pose) => pose.stamp_ns,
            Self::CrossTrackError(error) => error.stamp_ns,
        }
    }
}

/// True motion of the robot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Time, ns, on the LiDAR's clock.
    pub stamp_ns: i64,
    /// Pose of `base`, the rear-axle centre, in the world.
    pub base: Pose2,
    /// Pose of the LiDAR in the world.
    pub lidar: Pose2,
    /// True speed of the rear axle along x, m/s.
    pub speed_mps: f64,
    /// True angle of the steered wheel, rad, left positive.
    pub steering_rad: f64,
    /// True distance of `base` to the left of the path when the message was sent, m.
    pub cross_track_error_m: f64,
}

/// A message with the truth behind it.
#[derive(Debug, Clone, PartialEq)]
pub struct Emitted {
    /// Time of sending on the simulated clock, ns: a scan is sent only after its last beam.
    pub sent_ns: i64,
    /// The message.
    pub message: SimulatedMessage,
    /// The truth at the message's reference time: a scan's middle, a drive interval's end.
    pub truth: Truth,
    /// The truth when it was sent: a scan's end.
    pub truth_when_sent: Truth,
}

/// True values of the parameters that a calibration estimates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TrueParameters {
    /// Reading of the steering sensor when the wheel points straight ahead, rad.
    pub steering_offset_rad: f64,
    /// Pose of the LiDAR in `base`.
    pub lidar_in_base: Pose2,
    /// True speed over measured speed.
    pub speed_scale: f64,
    /// Distance between the axles, m.
    pub wheelbase_m: f64,
    /// Delay of a motion in the wheel odometry against the LiDAR's, s.
    pub time_offset_s: f64,
    /// True steering angle over the measured one less its offset.
    pub steering_gain: f64,
}
