//! Content of the recordings, message by message.

use fleetcal_proto::ros::{AckermannDriveStamped, LaserScan, Odometry, RosMessage};
use fleetcal_robot::recording::{AskedTopics, Recording, choose_scan_topic, choose_topics};
use fleetcal_tests::recording;

#[test]
fn simulated_scans_and_drive_samples_decode() {
    let Some(path) = recording::named("figure_eight.mcap") else {
        return;
    };
    let recording = Recording::open(&path).unwrap();
    let topics = choose_topics(recording.channels(), &AskedTopics::default()).unwrap();
    assert_eq!(topics.names(), ["/tugger_01/drive", "/tugger_01/scan"]);
    assert_eq!(topics.robot(), Some("tugger_01"));
    let (mut drives, mut scans, mut newest_ns) = (0, 0, 0);
    for message in recording.messages(&topics.names()).unwrap() {
        let message = message.unwrap();
        assert!(message.log_time_ns >= newest_ns);
        newest_ns = message.log_time_ns;
        if *message.topic == *topics.wheel_odometry_topic() {
            drives += 1;
            AckermannDriveStamped::from_cdr(&message.payload).unwrap();
        } else {
            scans += 1;
            let scan = LaserScan::from_cdr(&message.payload).unwrap();
            scan.check_beams().unwrap();
            assert_eq!(scan.ranges.len(), 1024);
        }
    }
    assert_eq!((drives, scans), (12_000, 1_198));
}

#[test]
fn poses_of_a_real_vehicle_decode() {
    let Some(path) = recording::named("sapienza_tricycle.mcap") else {
        return;
    };
    let recording = Recording::open(&path).unwrap();
    let topics = choose_topics(recording.channels(), &AskedTopics::default()).unwrap();
    assert_eq!(topics.names(), ["/agv/drive", "/agv/lidar_odometry"]);
    let poses = recording.messages(&["/agv/lidar_odometry"]).unwrap();
    let poses: Vec<Odometry> = poses
        .map(|pose| Odometry::from_cdr(&pose.unwrap().payload).unwrap())
        .collect();
    assert_eq!(poses.len(), 2434);
}

#[test]
fn real_scanners_are_checked_and_missing_drives_named() {
    for (file, topic, beams, count) in [
        ("unsw_ugv.mcap", "/ugv/scan", 361, 2073),
        ("freiburg_079.mcap", "/pioneer/scan", 360, 4791),
    ] {
        let Some(path) = recording::named(file) else {
            return;
        };
        let recording = Recording::open(&path).unwrap();
        assert_eq!(
            choose_scan_topic(recording.channels(), None).unwrap().topic,
            topic
        );
        let error = choose_topics(recording.channels(), &AskedTopics::default()).unwrap_err();
        assert!(
            error.to_string().contains("no wheel odometry topic"),
            "{error}"
        );
        let mut scans = 0;
        for message in recording.messages(&[topic]).unwrap() {
            let scan = LaserScan::from_cdr(&message.unwrap().payload).unwrap();
            assert_eq!(scan.ranges.len(), beams);
            scan.check_beams().unwrap();
            scans += 1;
        }
        assert_eq!(scans, count);
    }
}
