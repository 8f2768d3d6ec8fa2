//! Messages of a robot, as its checks take them.

use fleetcal_model::{Pose2, Stream};
use fleetcal_odometry::Scan;
use fleetcal_odometry::lidar_odometry::OdometryPose;

use crate::checks::{Checks, Head};
use crate::watch::Watch;

/// Taker of a robot's messages: [`Checks`] of a recording, or the [`Watch`] of a robot that sends.
pub trait Inputs {
    /// Takes speed, steering angle or both as they were sent.
    fn take_wheels(&mut self, head: &Head<'_>, speed: Option<f64>, steering: Option<f64>);
    /// Takes a scan, and the time from one scan to the next that it states, s (0 for none).
    fn take_scan(&mut self, head: &Head<'_>, scan: &Scan, scan_time_s: f64);
    /// Takes the pose that LiDAR odometry gives a scan.
    fn take_odometry(&mut self, pose: &OdometryPose);
    /// Takes a pose that the robot sends for its LiDAR, and the tilt of the pose's z axis, rad.
    fn take_pose(&mut self, head: &Head<'_>, pose: Pose2, tilt_rad: f64);
    /// Notes that a message was refused, and why.
    fn refuse(&mut self, stream: Stream, arrival_ns: i64, reason: &str);
}

macro_rules! inputs_of {
    ($($taker:ident),+) => {$(
        impl Inputs for $taker {
            fn take_wheels(&mut self, head: &Head<'_>, speed: Option<f64>, steering: Option<f64>) {
                self.take_wheels(head, speed, steering);
            }

            fn take_scan(&mut self, head: &Head<'_>, scan: &Scan, scan_time_s: f64) {
                self.take_scan(head, scan, scan_time_s);
            }

            fn take_odometry(&mut self, pose: &OdometryPose) {
                self.take_odometry(pose);
            }

            fn take_pose(&mut self, head: &Head<'_>, pose: Pose2, tilt_rad: f64) {
                self.take_pose(head, pose, tilt_rad);
            }

            fn refuse(&mut self, stream: Stream, arrival_ns: i64, reason: &str) {
                self.refuse(stream, arrival_ns, reason);
            }
        }
    )+};
}

inputs_of!(Checks, Watch);
