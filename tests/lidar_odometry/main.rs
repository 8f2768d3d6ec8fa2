//! LiDAR odometry held to its figures on recordings: two real vehicles, and the simulated
//! figure-eight. `estimator/benches/recordings.py` prints the same figures.

#![expect(clippy::expect_used, reason = "a test that cannot go on fails")]

mod error;
mod poles;

use std::path::Path;

use fleetcal_estimator::lidar_odometry::{OdometryPose, Tracking};
use fleetcal_estimator::stream::SweepShape;
use fleetcal_estimator::{LidarOdometry, Pose2, Stamp, Sweep};
use fleetcal_proto::ros::{LaserScan, Odometry, RosMessage};
use fleetcal_robot::recording::Recording;
use fleetcal_tests::{binary, recording};
use tempfile::TempDir;

/// The messages of a topic, in their order.
fn messages<M: RosMessage>(path: &Path, topic: &str) -> Vec<M> {
    let recording = Recording::open(path).expect("a whole recording");
    let messages = recording.messages(&[topic]).expect("readable");
    messages
        .map(|message| M::from_cdr(&message.expect("readable").payload).expect("of its type"))
        .collect()
}

fn sweep(scan: &LaserScan) -> Sweep {
    let shape = SweepShape {
        angle_min_rad: f64::from(scan.angle_min),
        angle_increment_rad: f64::from(scan.angle_increment),
        time_increment_s: f64::from(scan.time_increment),
        range_min_m: f64::from(scan.range_min),
        range_max_m: f64::from(scan.range_max),
    };
    let stamp = Stamp(scan.header.stamp.as_ns());
    Sweep::new(stamp, shape, scan.ranges.clone()).expect("a sweep")
}

/// What the odometry says of each scan that it can use.
fn odometry(scans: &[LaserScan]) -> Vec<(&LaserScan, OdometryPose)> {
    let mut odometry = LidarOdometry::default();
    let poses = scans
        .iter()
        .map(|scan| (scan, odometry.process(&sweep(scan))));
    poses
        .filter_map(|(scan, pose)| Some((scan, pose?)))
        .collect()
}

fn lost(poses: &[(&LaserScan, OdometryPose)]) -> usize {
    let is_lost = |pose: &OdometryPose| pose.tracking == Tracking::Lost || pose.map_restarted;
    poses
        .iter()
        .skip(1)
        .filter(|(_, pose)| is_lost(pose))
        .count()
}

/// A real vehicle in a yard for 223 s: its reflector poles stay where they are, from the first
/// sweep to the last.
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

/// A real robot in an office building for 17 minutes, four sweeps a second, against a grid SLAM's
/// poses, whose own noise is part of the figures.
#[test]
fn an_office_building_is_driven_through_without_a_loss() {
    let Some(path) = recording::named("freiburg_079.mcap") else {
        return;
    };
    let scans = messages::<LaserScan>(&path, "/pioneer/scan");
    let reference: Vec<(Stamp, Pose2)> = messages::<Odometry>(&path, "/reference/pose")
        .iter()
        .map(|message| {
            let pose = message.pose.pose;
            let yaw_rad = pose.orientation.yaw_rad();
            let pose = Pose2::new(pose.position.x, pose.position.y, yaw_rad);
            (Stamp(message.header.stamp.as_ns()), pose)
        })
        .collect();
    let poses = odometry(&scans);
    assert!(
        poses.len() > 4780,
        "{} of {} scans",
        poses.len(),
        scans.len()
    );
    assert_eq!(lost(&poses), 0);
    let pairs = error::matched(&poses, &reference);
    assert!(pairs.len() > 4000, "{} scans have a reference", pairs.len());
    for (scans, metres_max, degrees_max) in [(1, 0.014, 0.42), (10, 0.02, 0.6), (50, 0.03, 0.8)] {
        let (metres, degrees) = error::median_over(&pairs, scans);
        println!("over {scans} scans: {metres:.4} m, {degrees:.3} deg");
        assert!(metres <= metres_max, "{metres} m over {scans} scans");
        assert!(degrees <= degrees_max, "{degrees} deg over {scans} scans");
    }
}

/// The simulated figure-eight: every sweep fits.
#[test]
fn every_sweep_of_the_figure_eight_is_tracked() {
    let Some(path) = recording::named("figure_eight.mcap") else {
        return;
    };
    let scans = messages::<LaserScan>(&path, "/tugger_01/scan");
    let poses = odometry(&scans);
    assert_eq!((poses.len(), scans.len()), (1198, 1198));
    for (scan, pose) in &poses {
        let stamp = scan.header.stamp;
        assert_eq!(pose.tracking, Tracking::Tracking, "the sweep at {stamp:?}");
        assert!(pose.fitness > 0.5, "{} at {stamp:?}", pose.fitness);
    }
}

/// CPU time of a sweep of 1024 beams, from its message to its pose, deskew and map upkeep included:
/// a tenth of `small_gicp`'s, which `estimator/benches/peers/compare.py` measures in the same run.
#[test]
fn a_sweep_takes_no_more_than_a_tenth_of_the_next_best_engines_time() {
    const MEDIAN_MAX_MS: f64 = 0.137;
    let folder = TempDir::new().expect("a folder");
    let [path, out] = ["robot.mcap", "out.tum"].map(|name| folder.path().join(name));
    recording::simulated(&path, 60.0);
    let [path, out] = [&path, &out].map(|path| path.to_str().expect("a path of text"));
    // Of three runs the best: others may use the machine's caches.
    let medians_ms = (0..3).map(|_| {
        let summary = binary::run_json(["odometry", path, "--json", "--trajectory", out]);
        summary["scan_median_ms"].as_f64().expect("a number")
    });
    let median_ms = medians_ms.fold(f64::INFINITY, f64::min);
    println!("{median_ms} ms a sweep");
    assert!(median_ms < MEDIAN_MAX_MS, "{median_ms} ms a sweep");
}
