//! LiDAR odometry on the scans of two real vehicles. `odometry/benches/recordings.py` prints the
//! same figures.

use fleetcal_estimator::lidar_odometry::{OdometryPose, Tracking};
use fleetcal_estimator::{Pose2, RobotTime};
use fleetcal_proto::ros::{LaserScan, Odometry};
use fleetcal_tests::odometry::{messages, odometry};
use fleetcal_tests::recording;

use super::{error, poles};

fn lost(poses: &[(&LaserScan, OdometryPose)]) -> usize {
    let is_lost = |pose: &OdometryPose| pose.tracking == Tracking::Lost || pose.map_restarted;
    poses
        .iter()
        .skip(1)
        .filter(|(_, pose)| is_lost(pose))
        .count()
}

/// Checks a real vehicle in a yard for 223 s: its reflector poles stay in place from the first scan
/// to the last.
#[test]
fn reflector_poles_stay_where_they_are() {
    let Some(path) = recording::named("unsw_ugv.mcap") else {
        return;
    };
    let scans = messages::<LaserScan>(&path, "/ugv/scan");
    let poses = odometry(&scans);
    assert!(
        poses.len() > 2060,
        "{} of {} scans",
        poses.len(),
        scans.len()
    );
    assert_eq!(lost(&poses), 0);
    let returns: Vec<_> = poses.iter().flat_map(poles::reflections).collect();
    let poles = poles::find(&returns, 5);
    let (mut sum_m2, mut count) = (0.0, 0.0);
    for pole in &poles {
        let scatter_m = (pole.sum_m2 / pole.count).sqrt();
        let moved_m = pole.moved_m.expect("seen at both ends");
        println!(
            "pole at {:.2?}: scatter {scatter_m:.3} m, moved {moved_m:.3} m",
            pole.middle_m
        );
        assert!(
            moved_m < 0.05,
            "the pole at {:?} moved by {moved_m} m",
            pole.middle_m
        );
        sum_m2 += pole.sum_m2;
        count += pole.count;
    }
    let scatter_m = (sum_m2 / count).sqrt();
    println!("scatter of {count} returns from five poles: {scatter_m:.4} m");
    assert!(scatter_m < 0.04, "{scatter_m} m");
}

/// Checks a real robot in an office building for 17 minutes, four scans a second, against a grid
/// SLAM's poses, whose own noise is part of the figures.
#[test]
fn an_office_building_is_driven_through_on_one_map() {
    let Some(path) = recording::named("freiburg_079.mcap") else {
        return;
    };
    let scans = messages::<LaserScan>(&path, "/pioneer/scan");
    let reference: Vec<(RobotTime, Pose2)> = messages::<Odometry>(&path, "/reference/pose")
        .iter()
        .map(|message| {
            let pose = message.pose.pose;
            let yaw_rad = pose.orientation.yaw_rad();
            let pose = Pose2::new(pose.position.x, pose.position.y, yaw_rad);
            (RobotTime(message.header.stamp.as_ns()), pose)
        })
        .collect();
    let poses = odometry(&scans);
    assert!(
        poses.len() > 4780,
        "{} of {} scans",
        poses.len(),
        scans.len()
    );
    // Of one scan's 103 points 47 are people's.
    assert_eq!(lost(&poses), 0);
    let mut later = poses.iter().skip(1);
    assert!(later.all(|(_, pose)| !pose.map_restarted));
    let pairs = error::matched(&poses, &reference);
    assert!(pairs.len() > 4000, "{} scans have a reference", pairs.len());
    for (scans, metres_max, degrees_max) in [(1, 0.014, 0.42), (10, 0.02, 0.6), (50, 0.03, 0.8)] {
        let (metres, degrees) = error::median_over(&pairs, scans);
        println!("over {scans} scans: {metres:.4} m, {degrees:.3} deg");
        assert!(metres <= metres_max, "{metres} m over {scans} scans");
        assert!(degrees <= degrees_max, "{degrees} deg over {scans} scans");
    }
}
