use fleetcal_proto::ros::{AckermannDriveStamped, LaserScan, Odometry, PointCloud2, RosMessage};

use super::*;

fn channel(topic: &str, message_type: &str) -> Channel {
    let encoding = Some(Encoding::Cdr);
    Channel {
        topic: topic.into(),
        message_type: message_type.into(),
        encoding,
        count: 1,
    }
}

fn drive_on(topic: &str) -> Channel {
    channel(topic, AckermannDriveStamped::TYPE)
}

fn scan_on(topic: &str) -> Channel {
    channel(topic, LaserScan::TYPE)
}

fn odometry_on(topic: &str) -> Channel {
    channel(topic, Odometry::TYPE)
}

fn refused(
    channels: &[Channel],
    [drive, scan, pose]: [Option<&str>; 3],
    wanted: &[&str],
    exit_status: u8,
) {
    let error = choose_topics(channels, drive, scan, pose).unwrap_err();
    let sentence = error.to_string();
    for part in wanted {
        assert!(
            sentence.contains(part),
            "{sentence:?} does not say {part:?}"
        );
    }
    assert_eq!(error.exit_status(), exit_status, "{sentence}");
}

const NONE: [Option<&str>; 3] = [None; 3];

#[test]
fn sweeps_are_preferred_to_poses() {
    let channels = [
        drive_on("/a/drive"),
        scan_on("/a/scan"),
        odometry_on("/a/odom"),
    ];
    let topics = choose_topics(&channels, None, None, None).unwrap();
    assert_eq!(topics.pose, ChosenPose::Scan(scan_on("/a/scan")));
    let topics = choose_topics(&channels, None, None, Some("/a/odom")).unwrap();
    assert_eq!(
        topics.pose,
        ChosenPose::LidarOdometry(odometry_on("/a/odom"))
    );
    let topics = choose_topics(&channels[..2], None, None, None).unwrap();
    assert_eq!(topics.names(), ["/a/drive", "/a/scan"]);
    let only_poses = [drive_on("/drive"), odometry_on("/a/odom")];
    let topics = choose_topics(&only_poses, None, None, None).unwrap();
    assert_eq!(topics.names(), ["/drive", "/a/odom"]);
    assert_eq!(topics.robot(), None);
}

#[test]
fn what_is_missing_is_named() {
    let scan_only = [scan_on("/a/scan")];
    refused(
        &scan_only,
        NONE,
        &["no drive topic", AckermannDriveStamped::TYPE, "/a/scan"],
        65,
    );
    let drive_only = [drive_on("/a/drive"), channel("/a/image", "")];
    let wanted = [
        "no scan or LiDAR pose topic",
        LaserScan::TYPE,
        Odometry::TYPE,
        "/a/drive",
    ];
    refused(&drive_only, NONE, &wanted, 65);
    let error = choose_scan_topic(&drive_only, None).unwrap_err();
    assert!(error.to_string().contains("no scan topic"), "{error}");
    assert_eq!(error.exit_status(), 65);
}

#[test]
fn two_candidates_must_be_chosen_from() {
    let channels = [
        drive_on("/a/drive"),
        drive_on("/b/drive"),
        scan_on("/a/front"),
        scan_on("/a/rear"),
        odometry_on("/a/odom"),
    ];
    refused(
        &channels,
        NONE,
        &["2 drive topics", "/a/drive, /b/drive", "--drive-topic"],
        2,
    );
    let drive = Some("/a/drive");
    let wanted = ["2 scan topics", "/a/front, /a/rear", "--scan-topic"];
    refused(&channels, [drive, None, None], &wanted, 2);
    let topics = choose_topics(&channels, drive, Some("/a/rear"), None).unwrap();
    assert_eq!(topics.names(), ["/a/drive", "/a/rear"]);
    assert_eq!(
        choose_scan_topic(&channels, Some("/a/front"))
            .unwrap()
            .topic,
        "/a/front"
    );
    assert_eq!(
        choose_scan_topic(&channels, None)
            .unwrap_err()
            .exit_status(),
        2
    );
    let two_poses = [
        drive_on("/a/drive"),
        odometry_on("/a/odom"),
        odometry_on("/a/lidar"),
    ];
    refused(
        &two_poses,
        NONE,
        &["2 LiDAR pose topics", "--pose-topic"],
        2,
    );
}

#[test]
fn a_topic_that_cannot_be_is_named_with_what_could() {
    let mut image = channel("/a/scan3d", LaserScan::TYPE);
    image.encoding = None;
    let channels = [drive_on("/a/drive"), scan_on("/a/scan"), image];
    let wanted = [
        "--scan-topic is \"/a/scann\"",
        "/a/scan (sensor_msgs/msg/LaserScan)",
    ];
    refused(&channels, [None, Some("/a/scann"), None], &wanted, 2);
    let wanted = [
        "--pose-topic is \"/a/scan\"",
        LaserScan::TYPE,
        Odometry::TYPE,
    ];
    refused(&channels, [None, None, Some("/a/scan")], &wanted, 2);
    refused(
        &channels,
        [None, Some("/a/scan3d"), None],
        &["neither CDR nor JSON"],
        2,
    );
    refused(
        &channels,
        [None, Some("/a/scan"), Some("/a/scan")],
        &["are both given"],
        2,
    );
}

#[test]
fn clouds_do_where_there_are_no_sweeps() {
    let cloud = channel("/a/points", PointCloud2::TYPE);
    let channels = [drive_on("/a/drive"), cloud.clone(), odometry_on("/a/odom")];
    let topics = choose_topics(&channels, None, None, None).unwrap();
    assert_eq!(topics.pose, ChosenPose::Scan(cloud.clone()));
    assert_eq!(choose_scan_topic(&channels, None).unwrap(), cloud);
    let both = [drive_on("/a/drive"), cloud.clone(), scan_on("/a/scan")];
    let topics = choose_topics(&both, None, None, None).unwrap();
    assert_eq!(topics.names(), ["/a/drive", "/a/scan"]);
    let topics = choose_topics(&both, None, Some("/a/points"), None).unwrap();
    assert_eq!(topics.pose, ChosenPose::Scan(cloud));
}
