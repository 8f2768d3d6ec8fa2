use fleetcal_proto::ros::{
    AckermannDriveStamped, JointState, LaserScan, Odometry, PointCloud2, PoseStamped, RosMessage,
    SteeringReport, VelocityReport,
};

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

/// Makes the flags of drive, scan and pose.
fn asked([drive, scan, pose]: [Option<&str>; 3]) -> AskedTopics {
    let asked = |topic: Option<&str>, by| {
        let topic = topic?.to_owned();
        Some(AskedTopic { topic, by })
    };
    AskedTopics {
        wheel_odometry: asked(drive, "--wheel-odometry-topic"),
        scan: asked(scan, "--scan-topic"),
        pose: asked(pose, "--pose-topic"),
        ..AskedTopics::default()
    }
}

fn chosen(channels: &[Channel], flags: [Option<&str>; 3]) -> Topics {
    choose_topics(channels, &asked(flags)).unwrap()
}

fn refused(channels: &[Channel], flags: [Option<&str>; 3], wanted: &[&str], exit_status: u8) {
    let error = choose_topics(channels, &asked(flags)).unwrap_err();
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
fn scans_are_preferred_to_poses() {
    let channels = [
        drive_on("/a/drive"),
        scan_on("/a/scan"),
        odometry_on("/a/odom"),
    ];
    let topics = chosen(&channels, NONE);
    assert_eq!(topics.pose, ChosenPose::Scan(scan_on("/a/scan")));
    let topics = chosen(&channels, [None, None, Some("/a/odom")]);
    assert_eq!(
        topics.pose,
        ChosenPose::LidarOdometry(odometry_on("/a/odom"))
    );
    let topics = chosen(&channels[..2], [None, None, None]);
    assert_eq!(topics.names(), ["/a/drive", "/a/scan"]);
    let only_poses = [drive_on("/drive"), odometry_on("/a/odom")];
    let topics = chosen(&only_poses, [None, None, None]);
    assert_eq!(topics.names(), ["/drive", "/a/odom"]);
    assert_eq!(topics.robot(), None);
}

#[test]
fn what_is_missing_is_named() {
    let scan_only = [scan_on("/a/scan")];
    refused(
        &scan_only,
        NONE,
        &[
            "no wheel odometry topic",
            AckermannDriveStamped::TYPE,
            "/a/scan",
        ],
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
    // Of what is there and would do, the flag is named that takes it.
    let joints = [channel("/a/joint_states", JointState::TYPE)];
    let wanted = [
        "no wheel odometry topic",
        JointState::TYPE,
        "--wheel-odometry-topic names",
    ];
    refused(&joints, NONE, &wanted, 65);
    let poses = [drive_on("/a/drive"), channel("/a/pose", PoseStamped::TYPE)];
    refused(&poses, NONE, &[PoseStamped::TYPE, "--pose-topic names"], 65);
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
        &[
            "2 wheel odometry topics",
            "/a/drive, /b/drive",
            "--wheel-odometry-topic",
        ],
        2,
    );
    let drive = Some("/a/drive");
    let wanted = ["2 scan topics", "/a/front, /a/rear", "--scan-topic"];
    refused(&channels, [drive, None, None], &wanted, 2);
    let topics = chosen(&channels, [drive, Some("/a/rear"), None]);
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
        "--scan-topic: got \"/a/scann\"",
        "/a/scan (sensor_msgs/msg/LaserScan)",
    ];
    refused(&channels, [None, Some("/a/scann"), None], &wanted, 2);
    let wanted = [
        "--pose-topic: got \"/a/scan\"",
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
fn clouds_do_where_there_are_no_scans() {
    let cloud = channel("/a/points", PointCloud2::TYPE);
    let channels = [drive_on("/a/drive"), cloud.clone(), odometry_on("/a/odom")];
    let topics = chosen(&channels, NONE);
    assert_eq!(topics.pose, ChosenPose::Scan(cloud.clone()));
    assert_eq!(choose_scan_topic(&channels, None).unwrap(), cloud);
    let both = [drive_on("/a/drive"), cloud.clone(), scan_on("/a/scan")];
    let topics = chosen(&both, [None, None, None]);
    assert_eq!(topics.names(), ["/a/drive", "/a/scan"]);
    let topics = chosen(&both, [None, Some("/a/points"), None]);
    assert_eq!(topics.pose, ChosenPose::Scan(cloud));
}

/// Makes a recording of joints and odometry beside the scans.
fn of_halves() -> [Channel; 4] {
    [
        channel("/a/joint_states", JointState::TYPE),
        odometry_on("/a/odom"),
        scan_on("/a/scan"),
        channel("/a/pose", PoseStamped::TYPE),
    ]
}

fn halves(steering: &str, speed: &str) -> AskedTopics {
    let asked = |topic: &str, by| {
        let topic = topic.to_owned();
        Some(AskedTopic { topic, by })
    };
    AskedTopics {
        steering: asked(steering, "streams.steering"),
        speed: asked(speed, "streams.speed"),
        ..AskedTopics::default()
    }
}

#[test]
fn steering_and_speed_have_topics_of_their_own_when_asked_for() {
    let channels = of_halves();
    let topics = choose_topics(&channels, &halves("/a/joint_states", "/a/odom")).unwrap();
    assert_eq!(topics.names(), ["/a/joint_states", "/a/odom", "/a/scan"]);
    assert_eq!(topics.robot(), Some("a"));
    // The wheels' odometry is never taken for the LiDAR's; a pose is when it is asked for.
    let without_scans: Vec<Channel> = [0, 1, 3].map(|at| channels[at].clone()).into();
    let error = choose_topics(&without_scans, &halves("/a/joint_states", "/a/odom"));
    let sentence = error.unwrap_err().to_string();
    assert!(
        sentence.contains("no scan or LiDAR pose topic"),
        "{sentence}"
    );
    let mut with_pose = halves("/a/joint_states", "/a/odom");
    with_pose.pose = asked([None, None, Some("/a/pose")]).pose;
    let topics = choose_topics(&without_scans, &with_pose).unwrap();
    assert!(matches!(topics.pose, ChosenPose::LidarOdometry(pose) if pose.topic == "/a/pose"));
}

#[test]
fn halves_that_cannot_be_are_named() {
    let channels = of_halves();
    let sentence = |asked: &AskedTopics| {
        let error = choose_topics(&channels, asked).unwrap_err();
        assert_eq!(error.exit_status(), 2, "{error}");
        error.to_string()
    };
    let said = sentence(&halves("/a/joint_states", "/a/joint_states"));
    assert!(said.contains("--wheel-odometry-topic"), "{said}");
    let said = sentence(&halves("/a/scan", "/a/odom"));
    assert!(said.contains("streams.steering: got \"/a/scan\""), "{said}");
    let mut alone = halves("/a/joint_states", "/a/odom");
    alone.speed = None;
    let said = sentence(&alone);
    assert!(said.contains("streams.steering alone is given"), "{said}");
    let mut three = halves("/a/joint_states", "/a/odom");
    three.wheel_odometry = asked([Some("/a/drive"), None, None]).wheel_odometry;
    assert!(
        sentence(&three)
            .contains("--wheel-odometry-topic and streams.steering and streams.speed are")
    );
}

#[test]
fn reports_of_autoware_are_found_by_their_types() {
    let steering = channel("/vehicle/status/steering_status", SteeringReport::TYPE);
    let speed = channel("/vehicle/status/velocity_status", VelocityReport::TYPE);
    let topics = chosen(&[speed.clone(), scan_on("/scan"), steering.clone()], NONE);
    let halves = ChosenWheelOdometry::Halves { steering, speed };
    assert_eq!(topics.wheel_odometry, halves);
}
