//! Robots of recordings that describe themselves, and of `--urdf`.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::Path;

use clap::Parser;
use fleetcal_estimator::vehicle::SpeedMeasuredAt;
use fleetcal_proto::ros::{
    AckermannDriveStamped, Header, JointState, LaserScan, Odometry, RosMessage, StringMessage,
    TfMessage, TransformStamped,
};
use fleetcal_robot::recording::ChosenWheelOdometry;
use mcap::WriteOptions;
use mcap::records::MessageHeader;
use tempfile::TempDir;

use super::*;

/// The simulator's vehicle.
const TUGGER: &str = include_str!("../../../../proto/description/tests/urdf/tugger.urdf");

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    robot: RobotArguments,
}

/// Vehicle that drives its one steered wheel.
const TRICYCLE: &str = include_str!("../../../../proto/description/tests/urdf/tricycle.urdf");

/// Topic, type and payload of a message.
type Written = (&'static str, &'static str, Vec<u8>);

fn message<M: RosMessage>(topic: &'static str, message: &M) -> Written {
    (topic, M::TYPE, message.to_cdr())
}

fn record(path: &Path, messages: &[Written]) {
    let file = File::create(path).unwrap();
    let mut writer = WriteOptions::new().profile("ros2").create(file).unwrap();
    for (at, (topic, of_type, payload)) in messages.iter().enumerate() {
        let schema = writer.add_schema(of_type, "ros2msg", b"").unwrap();
        let channel = writer.add_channel(schema, topic, "cdr", &BTreeMap::new());
        let header = MessageHeader {
            channel_id: channel.unwrap(),
            sequence: 0,
            log_time: at as u64,
            publish_time: at as u64,
        };
        writer.write_to_known_channel(&header, payload).unwrap();
    }
    writer.finish().unwrap();
}

fn urdf(topic: &'static str, text: &str) -> Written {
    let data = text.to_owned();
    message(topic, &StringMessage { data })
}

/// A transform from the vehicle's frame to `child`, at x = 0.9 m.
fn mounted(child: &str) -> Written {
    let mut mounted = TransformStamped {
        child_frame_id: child.to_owned(),
        ..TransformStamped::default()
    };
    mounted.header.frame_id = "base_link".to_owned();
    mounted.transform.translation.x = 0.9;
    let transforms = vec![mounted];
    message("/tf_static", &TfMessage { transforms })
}

fn scan(frame: &str) -> Written {
    let header = Header {
        frame_id: frame.to_owned(),
        ..Header::default()
    };
    let ranges = vec![1.0_f32; 4];
    let scan = LaserScan {
        header,
        angle_min: -1.0,
        angle_max: 1.0,
        angle_increment: 0.5,
        time_increment: 0.0,
        scan_time: 0.1,
        range_min: 0.1,
        range_max: 10.0,
        ranges: ranges.into(),
        intensities: Vec::new().into(),
    };
    message("/scan", &scan)
}

fn joints(names: &[&str]) -> Written {
    let state = JointState {
        name: names.iter().map(|&name| name.to_owned()).collect(),
        position: vec![0.0; names.len()],
        velocity: vec![0.0; names.len()],
        ..JointState::default()
    };
    message("/joint_states", &state)
}

fn drive() -> Written {
    message(
        "/tugger_01/wheel_odometry",
        &AckermannDriveStamped::default(),
    )
}

const ALL_JOINTS: [&str; 3] = [
    "rear_left_wheel_joint",
    "steer_joint",
    "rear_right_wheel_joint",
];

fn robot_of(recording: &Path, flags: &[&str]) -> Result<RecordedRobot, CommandError> {
    let line = Line::try_parse_from(["test"].iter().chain(flags)).unwrap();
    line.robot.of(&Recording::open(recording).unwrap())
}

fn used(robot: &RecordedRobot) -> Vec<&str> {
    let values = robot.description.iter().flat_map(|of| &of.values);
    let used = values.filter(|value| value.used);
    used.map(|value| value.key.as_str()).collect()
}

#[test]
fn a_robot_that_describes_itself_needs_no_flag() {
    let folder = TempDir::new().unwrap();
    record(
        &folder.path().join("bag_0.mcap"),
        &[
            urdf("/robot_description", TUGGER),
            mounted("scanner"),
            joints(&ALL_JOINTS),
            scan("scanner"),
        ],
    );
    let robot = robot_of(folder.path(), &[]).unwrap();
    assert!((robot.config.wheelbase_m.metres() - 1.2).abs() < 1e-9);
    let joints = robot.config.streams.joints().unwrap();
    assert_eq!(joints.steering.as_deref(), Some("steer_joint"));
    // 0.9 m ahead of base_link, which is 0.4 m ahead of the rear axle.
    let mount = robot.config.nominal_extrinsics.unwrap().pose();
    assert!((mount.x_m - 1.3).abs() < 1e-9);
    let ChosenWheelOdometry::Whole(channel) = &robot.topics.wheel_odometry else {
        panic!("{:?}", robot.topics);
    };
    assert_eq!(channel.topic, "/joint_states");
    let keys = [
        "model",
        "speed_measured_at",
        "wheelbase_m",
        "streams.joints",
        "rear_axle_in_base_link",
        "nominal_extrinsics",
    ];
    assert_eq!(used(&robot), keys);
    let description = robot.description.unwrap();
    assert_eq!(description.origins, ["/robot_description", "/tf_static"]);
}

#[test]
fn a_joint_state_with_the_steering_alone_is_paired_with_the_only_odometry() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("drive.mcap");
    let described = urdf("/tugger_01/robot_description", TUGGER);
    let odometry = message("/odom", &Odometry::default());
    let all = [described, joints(&["steer_joint"]), odometry, scan("lidar")];
    record(&path, &all);
    let robot = robot_of(&path, &[]).unwrap();
    let ChosenWheelOdometry::Halves { steering, speed } = &robot.topics.wheel_odometry else {
        panic!("{:?}", robot.topics);
    };
    assert_eq!([&steering.topic, &speed.topic], ["/joint_states", "/odom"]);
    // Without the joint nothing is guessed.
    record(
        &path,
        &[
            all[0].clone(),
            joints(&["arm"]),
            all[2].clone(),
            all[3].clone(),
        ],
    );
    assert!(matches!(robot_of(&path, &[]), Err(CommandError::Topics(_))));
}

#[test]
fn the_other_files_of_a_folder_are_searched_where_the_vehicle_is_unknown() {
    let folder = TempDir::new().unwrap();
    let [first, second] = ["bag_0.mcap", "bag_1.mcap"].map(|name| folder.path().join(name));
    record(&first, &[urdf("/robot_description", TUGGER)]);
    record(&second, &[mounted("scanner"), drive(), scan("scanner")]);
    let wanted = format!("/robot_description of {}", first.display());
    let found = || robot_of(&second, &[]).unwrap().description.unwrap();
    let loose = found();
    assert_eq!(loose.origins, ["/tf_static", &wanted]);
    let metadata = "rosbag2_bagfile_information: {relative_file_paths: [bag_0.mcap, bag_1.mcap]}";
    fs::write(folder.path().join("metadata.yaml"), metadata).unwrap();
    assert_eq!(found(), loose);

    let known = robot_of(&second, &["--wheelbase", "1.2"]).unwrap();
    assert_eq!(known.description.unwrap().origins, ["/tf_static"]);

    // Of two different descriptions none is taken.
    fs::remove_file(folder.path().join("metadata.yaml")).unwrap();
    let longer = TUGGER.replace("xyz=\"0.8 0 0.2\"", "xyz=\"1.8 0 0.2\"");
    record(
        &folder.path().join("other.mcap"),
        &[urdf("/robot_description", &longer)],
    );
    let refused = robot_of(&second, &[]).unwrap_err().to_string();
    assert!(
        refused.contains("have different descriptions: none is used"),
        "{refused}"
    );
}

#[test]
fn a_urdf_gives_the_vehicle_and_flags_win_over_it() {
    let folder = TempDir::new().unwrap();
    let [path, urdf] = ["drive.mcap", "a.urdf"].map(|name| folder.path().join(name));
    record(&path, &[drive(), scan("lidar")]);
    fs::write(&urdf, TUGGER).unwrap();
    let urdf = urdf.to_str().unwrap();
    let robot = robot_of(&path, &["--urdf", urdf]).unwrap();
    assert_eq!(robot.id.as_str(), "tugger_01");
    assert!((robot.config.nominal_extrinsics.unwrap().pose().x_m - 0.434).abs() < 1e-9);
    assert_eq!(robot.description.unwrap().origins, [urdf]);

    let flags = ["--urdf", urdf, "--wheelbase", "1.55", "--model", "tricycle"];
    let robot = robot_of(&path, &flags).unwrap();
    assert!((robot.config.wheelbase_m.metres() - 1.55).abs() < 1e-9);
    assert_eq!(robot.config.model, VehicleModel::Tricycle);
    assert!(!used(&robot).contains(&"wheelbase_m"));
    let remarks = robot.description.unwrap().remarks;
    for wanted in ["model: \"tricycle\" is used", "wheelbase_m: 1.55 is used"] {
        assert!(
            remarks.iter().any(|of| of.starts_with(wanted)),
            "{remarks:?}"
        );
    }
}

#[test]
fn the_place_of_the_speed_comes_with_the_described_model_alone() {
    let folder = TempDir::new().unwrap();
    let named = ["drive.mcap", "a.urdf", "fleetcal.toml"];
    let [path, urdf, config] = named.map(|name| folder.path().join(name));
    record(&path, &[drive(), scan("lidar")]);
    let driven_behind = TRICYCLE.replace("xyz=\"0.7 0 -0.3\"", "xyz=\"-2.3 0 -0.3\"");
    fs::write(&urdf, driven_behind).unwrap();
    let entry = "[[robot]]\nid = \"tugger_01\"\nmodel = \"rear_steered\"\nwheelbase_m = 1.5\n";
    fs::write(&config, entry).unwrap();
    let place = |flags: &[&str]| {
        let urdf = ["--urdf", urdf.to_str().unwrap()];
        let robot = robot_of(&path, &[&urdf[..], flags].concat()).unwrap();
        let vehicle = robot.config.vehicle();
        assert_eq!(vehicle.model, VehicleModel::RearSteered);
        vehicle.speed_measured_at
    };
    assert_eq!(place(&[]), SpeedMeasuredAt::SteeredWheel);
    let flag = ["--model", "rear_steered"];
    assert_eq!(place(&flag), SpeedMeasuredAt::RearAxle);
    let config = ["--config", config.to_str().unwrap()];
    assert_eq!(place(&config), SpeedMeasuredAt::RearAxle);
}

#[test]
fn a_description_that_does_not_say_enough_is_named() {
    let folder = TempDir::new().unwrap();
    let [path, urdf] = ["drive.mcap", "a.urdf"].map(|name| folder.path().join(name));
    record(&path, &[drive(), scan("lidar")]);
    let refused = |text: &str| {
        fs::write(&urdf, text).unwrap();
        let refused = robot_of(&path, &["--urdf", urdf.to_str().unwrap()]).unwrap_err();
        (refused.exit_status(), refused.to_string())
    };
    let unpowered = TUGGER.replace("name=\"velocity\"", "name=\"temperature\"");
    let unsteered = TUGGER.replace(
        "\"steer_joint\" type=\"revolute\"",
        "\"steer_joint\" type=\"fixed\"",
    );
    let template = "<robot name=\"a\" xmlns:xacro=\"http://ros.org/wiki/xacro\"><xacro:a/></robot>";
    for (text, wanted) in [
        ("wheelbase: 1.2", "got no XML"),
        (template, "expected an expanded URDF"),
        (
            &unsteered,
            "wheels of several axles: rear_left_wheel_joint at x -0.400 m",
        ),
        (&unpowered, "the model is missing: give --model"),
    ] {
        let (status, sentence) = refused(text);
        assert!(
            status == 2 && sentence.contains(wanted),
            "{status}: {sentence}"
        );
    }
    let none = robot_of(&path, &["--urdf", "/none.urdf"]).unwrap_err();
    assert_eq!(none.exit_status(), 74);
    // Nothing is said of a robot that describes nothing.
    let robot = robot_of(&path, &["--wheelbase", "1.2"]).unwrap();
    assert_eq!(robot.description, None);
}
