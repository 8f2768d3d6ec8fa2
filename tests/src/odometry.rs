//! LiDAR odometry over the scans of a recording.

use std::path::Path;

use fleetcal_estimator::lidar_odometry::OdometryPose;
use fleetcal_estimator::stream::ScanShape;
use fleetcal_estimator::{LidarOdometry, RobotTime, Scan};
use fleetcal_proto::ros::{LaserScan, RosMessage};
use fleetcal_robot::recording::Recording;

/// Returns the messages of a topic, in their order.
///
/// # Panics
/// When the recording cannot be read.
pub fn messages<M: RosMessage>(path: &Path, topic: &str) -> Vec<M> {
    let recording = Recording::open(path).expect("a whole recording");
    let messages = recording.messages(&[topic]).expect("readable");
    messages
        .map(|message| M::from_cdr(&message.expect("readable").payload).expect("of its type"))
        .collect()
}

fn scan_of(scan: &LaserScan) -> Scan {
    let shape = ScanShape {
        angle_min_rad: f64::from(scan.angle_min),
        angle_increment_rad: f64::from(scan.angle_increment),
        time_increment_s: f64::from(scan.time_increment),
        range_min_m: f64::from(scan.range_min),
        range_max_m: f64::from(scan.range_max),
    };
    let stamp = RobotTime(scan.header.stamp.as_ns());
    Scan::new(stamp, shape, scan.ranges.clone()).expect("a scan")
}

/// Returns the odometry's pose of each usable scan.
///
/// # Panics
/// When a scan is invalid.
pub fn odometry(scans: &[LaserScan]) -> Vec<(&LaserScan, OdometryPose)> {
    let mut odometry = LidarOdometry::default();
    let poses = scans
        .iter()
        .map(|scan| (scan, odometry.process(&scan_of(scan))));
    poses
        .filter_map(|(scan, pose)| Some((scan, pose?)))
        .collect()
}
