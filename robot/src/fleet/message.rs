//! Simulated messages as the ROS 2 messages that travel.

use fleetcal_proto::ros::{
    AckermannDrive, AckermannDriveStamped, DRIVE_SAMPLES_MAX, DRIVE_SAMPLES_SPAN_MAX_NS,
    DriveSamples, Header, LaserScan, MeasuredDrive, Odometry, Pose, PoseStamped, Quaternion,
    SamplesRefused, Time, Vector3,
};
use thiserror::Error;

use crate::simulator::{DriveSample, LidarPose, Pose2, Scan, Truth};

/// Error of a stamp that a ROS message cannot represent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("header.stamp: got {stamp_ns} ns, expected 68 years around 1970")]
pub struct StampRefused {
    /// The stamp, ns since 1970.
    pub stamp_ns: i64,
}

fn time(stamp_ns: i64) -> Result<Time, StampRefused> {
    Time::from_ns(stamp_ns).ok_or(StampRefused { stamp_ns })
}

fn header(stamp_ns: i64, frame_id: &str) -> Result<Header, StampRefused> {
    let stamp = time(stamp_ns)?;
    Ok(Header {
        stamp,
        frame_id: frame_id.to_owned(),
    })
}

/// Converts a drive sample to `ackermann_msgs/msg/AckermannDriveStamped`.
///
/// # Errors
/// When its stamp does not fit.
pub fn drive_message(drive: &DriveSample) -> Result<AckermannDriveStamped, StampRefused> {
    Ok(AckermannDriveStamped {
        header: header(drive.stamp_ns, "base")?,
        drive: AckermannDrive {
            steering_angle: drive.steering_rad as f32,
            speed: drive.speed_mps as f32,
            ..AckermannDrive::default()
        },
    })
}

/// Drive samples of a robot that wait until a message is full.
#[derive(Debug, Default)]
pub struct DriveBatch {
    samples: Vec<MeasuredDrive>,
}

impl DriveBatch {
    /// Adds a drive sample; returns the message of those before it, if this one does not fit into
    /// it.
    ///
    /// # Errors
    /// When its stamp does not fit, or a value is not finite.
    pub fn add(&mut self, drive: &DriveSample) -> Result<Option<DriveSamples>, DriveRefused> {
        let sample = MeasuredDrive {
            stamp: time(drive.stamp_ns)?,
            steering_angle: drive.steering_rad as f32,
            speed: drive.speed_mps as f32,
        };
        let fits = match self.samples.as_slice() {
            [] => true,
            [first, ..] if self.samples.len() < DRIVE_SAMPLES_MAX => {
                let last = self.samples.last().unwrap_or(first);
                let is_near = drive.stamp_ns - first.stamp.as_ns() < DRIVE_SAMPLES_SPAN_MAX_NS;
                is_near && sample.stamp > last.stamp
            }
            _ => false,
        };
        let full = if fits { None } else { self.take()? };
        self.samples.push(sample);
        Ok(full)
    }

    /// Returns the message of the samples that wait; `None` if there are none.
    ///
    /// # Errors
    /// When a value is not finite.
    pub fn take(&mut self) -> Result<Option<DriveSamples>, DriveRefused> {
        let samples = std::mem::take(&mut self.samples);
        let is_any = !samples.is_empty();
        Ok(is_any.then(|| DriveSamples::new(samples)).transpose()?)
    }
}

/// Reason for which a drive sample does not fit into a message.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum DriveRefused {
    /// A ROS message cannot represent its stamp.
    #[error(transparent)]
    Stamp(#[from] StampRefused),
    /// It contradicts the samples before it.
    #[error(transparent)]
    Samples(#[from] SamplesRefused),
}

/// Converts a scan to `sensor_msgs/msg/LaserScan`.
///
/// # Errors
/// When its stamp does not fit.
pub fn scan_message(scan: Scan) -> Result<LaserScan, StampRefused> {
    let gaps = scan.ranges_m.len().saturating_sub(1) as f64;
    Ok(LaserScan {
        header: header(scan.stamp_ns, "lidar")?,
        angle_min: scan.angle_min_rad as f32,
        angle_max: (scan.angle_min_rad + gaps * scan.angle_increment_rad) as f32,
        angle_increment: scan.angle_increment_rad as f32,
        time_increment: scan.time_increment_s as f32,
        scan_time: scan.scan_time_s as f32,
        range_min: scan.range_min_m as f32,
        range_max: scan.range_max_m as f32,
        ranges: scan.ranges_m.into(),
        intensities: Vec::new().into(),
    })
}

/// Converts the true pose of `base` in the world to `geometry_msgs/msg/PoseStamped`.
///
/// # Errors
/// When its stamp does not fit.
pub fn truth_message(truth: &Truth) -> Result<PoseStamped, StampRefused> {
    Ok(PoseStamped {
        header: header(truth.stamp_ns, "world")?,
        pose: ros_pose(&truth.base),
    })
}

fn ros_pose(pose: &Pose2) -> Pose {
    Pose {
        position: Vector3 {
            x: pose.x_m,
            y: pose.y_m,
            z: 0.0,
        },
        orientation: Quaternion::from_yaw(pose.yaw_rad),
    }
}

/// Converts a LiDAR pose to `nav_msgs/msg/Odometry`.
///
/// # Errors
/// When its stamp does not fit.
pub fn lidar_pose_message(pose: &LidarPose) -> Result<Odometry, StampRefused> {
    let mut message = Odometry {
        header: header(pose.stamp_ns, "lidar_odometry")?,
        child_frame_id: "lidar".to_owned(),
        ..Odometry::default()
    };
    message.pose.pose = ros_pose(&pose.pose);
    if let Some(covariance) = pose.covariance {
        // Rows and columns of x, y and yaw among the six of a ROS pose.
        let six = [0, 1, 5];
        for (row, values) in six.into_iter().zip(covariance) {
            for (column, value) in six.into_iter().zip(values) {
                if let Some(place) = message.pose.covariance.get_mut(6 * row + column) {
                    *place = value;
                }
            }
        }
    }
    Ok(message)
}
