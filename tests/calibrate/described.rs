//! Recordings of robots that describe themselves, and `--urdf`.

use std::fs;
use std::path::{Path, PathBuf};

use fleetcal_proto::ros::{
    AckermannDriveStamped, JointState, Quaternion, RosMessage, StringMessage, TfMessage,
    TransformStamped,
};
use fleetcal_robot::fleet::RecordedTruth;
use fleetcal_tests::report::assert_near;
use fleetcal_tests::rewritten::{Rewritten, rewritten};
use fleetcal_tests::{binary, recording};
use serde_json::Value;
use tempfile::TempDir;

use super::{assert_refused, calibrate};

/// The simulator's vehicle.
const TUGGER: &str = include_str!("../../proto/description/tests/urdf/tugger.urdf");
/// Radius of its wheels, m.
const RADIUS_M: f64 = 0.15;

/// What a robot publishes of itself, once.
fn description() -> (StringMessage, TfMessage) {
    let data = TUGGER.replace("<link name=\"lidar\"/>", "<link name=\"mast\"/>");
    let data = data.replace("<child link=\"lidar\"/>", "<child link=\"mast\"/>");
    let mut mounted = TransformStamped {
        child_frame_id: "lidar".to_owned(),
        ..TransformStamped::default()
    };
    mounted.header.frame_id = "mast".to_owned();
    mounted.transform.rotation = Quaternion::from_yaw(0.0);
    let transforms = vec![mounted];
    (StringMessage { data }, TfMessage { transforms })
}

/// Writes a recording with the drive as joints, or with the description, or with both.
fn written(from: &Path, to: &Path, has_drive: bool, has_description: bool) {
    let mut is_first = true;
    rewritten(from, to, |message_type, of| {
        let mut messages = Vec::new();
        if is_first && has_description {
            let (urdf, transforms) = description();
            messages.push(Rewritten::on("/robot_description", of, &urdf));
            messages.push(Rewritten::on("/tf_static", of, &transforms));
        }
        is_first = false;
        if !has_drive {
            return messages;
        }
        if message_type == AckermannDriveStamped::TYPE {
            let drive = AckermannDriveStamped::from_cdr(&of.payload).unwrap();
            let wheel_radps = f64::from(drive.drive.speed) / RADIUS_M;
            let names = [
                "steer_joint",
                "rear_left_wheel_joint",
                "rear_right_wheel_joint",
            ];
            let joints = JointState {
                header: drive.header,
                name: names.map(str::to_owned).to_vec(),
                position: vec![f64::from(drive.drive.steering_angle), 0.0, 0.0],
                velocity: vec![0.0, wheel_radps, wheel_radps],
                effort: Vec::new(),
            };
            messages.push(Rewritten::on("/joint_states", of, &joints));
        } else {
            messages.push(Rewritten::unchanged(message_type, of));
        }
        messages
    });
}

fn simulated(folder: &TempDir, duration_s: f64) -> (PathBuf, RecordedTruth) {
    let path = folder.path().join("robot.mcap");
    let truth = recording::simulated(&path, duration_s);
    (path, truth)
}

/// Keys of the description's values that are used, and the report.
fn used(report: &Value) -> Vec<&str> {
    let values = report["description"]["values"].as_array().unwrap().iter();
    let used = values.filter(|value| value["used"] == true);
    used.map(|value| value["key"].as_str().unwrap()).collect()
}

const ALL: [&str; 5] = [
    "model",
    "wheelbase_m",
    "streams.joints",
    "rear_axle_in_base_link",
    "nominal_extrinsics",
];

#[test]
fn a_robot_that_describes_itself_is_calibrated_without_a_flag() {
    let folder = TempDir::new().unwrap();
    let (robot, truth) = simulated(&folder, 60.0);
    let bag = folder.path().join("bag");
    fs::create_dir(&bag).unwrap();
    written(&robot, &bag.join("bag_0.mcap"), true, true);
    let report = binary::run_json(["calibrate", bag.to_str().unwrap(), "--json"]);
    assert_eq!(used(&report), ALL);
    let origins = &report["description"]["origins"];
    assert_eq!(
        *origins,
        serde_json::json!(["/robot_description", "/tf_static"])
    );
    assert_eq!(report["vehicle"]["model"], "bicycle");
    let truth = truth.parameters;
    let cases = [
        ("steering_offset", truth.steering_offset_rad, 0.0015),
        ("lidar_x", truth.lidar_x_m, 0.006),
        ("lidar_yaw", truth.lidar_yaw_rad, 0.0015),
    ];
    assert_near(&report, &cases, 5.0, [0.0; 2]);

    let output = calibrate(&bag, &[]);
    let table = String::from_utf8(output.stdout).unwrap();
    for wanted in [
        "description: /robot_description, /tf_static\n",
        "  wheelbase_m = 1.2, by URDF: rear_left_wheel_joint, rear_right_wheel_joint to steer_joint\n",
    ] {
        assert!(table.contains(wanted), "{wanted}: {table}");
    }
}

#[test]
fn the_description_is_found_in_the_first_file_of_a_split_recording_or_beside_one() {
    let folder = TempDir::new().unwrap();
    let (robot, _) = simulated(&folder, 10.0);
    let bag = folder.path().join("bag");
    fs::create_dir(&bag).unwrap();
    let [first, second] = ["bag_0.mcap", "bag_1.mcap"].map(|name| bag.join(name));
    written(&robot, &first, false, true);
    written(&robot, &second, true, false);
    let wanted = format!("/robot_description of {}", first.display());
    let calibrated = || binary::run_json(["calibrate", second.to_str().unwrap(), "--json"]);
    let report = calibrated();
    assert_eq!(used(&report), ALL);
    assert_eq!(report["description"]["origins"][0], wanted.as_str());
    let metadata = "rosbag2_bagfile_information: {relative_file_paths: [bag_0.mcap, bag_1.mcap]}";
    fs::write(bag.join("metadata.yaml"), metadata).unwrap();
    assert_eq!(calibrated()["description"], report["description"]);

    // Of two different descriptions in a folder of loose files none is taken.
    fs::remove_file(bag.join("metadata.yaml")).unwrap();
    let other = bag.join("other.mcap");
    rewritten(&first, &other, |message_type, of| {
        let mut message = Rewritten::unchanged(message_type, of);
        if message_type == StringMessage::TYPE {
            let data = TUGGER.replace("xyz=\"0.8 0 0.2\"", "xyz=\"1.8 0 0.2\"");
            message = Rewritten::on("/robot_description", of, &StringMessage { data });
        }
        vec![message]
    });
    assert_eq!(calibrate(&second, &[]).status.code(), Some(65));
}

#[test]
fn a_urdf_gives_the_vehicle_and_flags_win_over_it() {
    let folder = TempDir::new().unwrap();
    let (robot, _) = simulated(&folder, 10.0);
    let urdf = folder.path().join("tugger.urdf");
    fs::write(&urdf, TUGGER).unwrap();
    let urdf = urdf.to_str().unwrap();
    let output = calibrate(&robot, &["--urdf", urdf, "--json"]);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(used(&report), ALL);
    assert_eq!(report["description"]["origins"], serde_json::json!([urdf]));
    assert!((report["vehicle"]["wheelbase_m"].as_f64().unwrap() - 1.2).abs() < 1e-9);

    let flags = ["--urdf", urdf, "--wheelbase", "1.55", "--json"];
    let output = calibrate(&robot, &flags);
    let said = String::from_utf8(output.stderr).unwrap();
    let wanted = "fleetcal: wheelbase_m: 1.55 is used, and the description has 1.2";
    assert!(said.contains(wanted), "{said}");
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["vehicle"]["wheelbase_m"], 1.55);
    assert!(!used(&report).contains(&"wheelbase_m"));
}

#[test]
fn a_urdf_that_does_not_say_enough_is_refused_in_one_sentence() {
    let folder = TempDir::new().unwrap();
    let (robot, _) = simulated(&folder, 3.0);
    let urdf = folder.path().join("robot.urdf");
    let refused = |text: &str, status, wanted| {
        fs::write(&urdf, text).unwrap();
        let output = calibrate(&robot, &["--urdf", urdf.to_str().unwrap()]);
        assert_refused(&output, status, wanted);
    };
    refused("wheelbase: 1.2", 2, "got no XML");
    let template = "<robot name=\"a\" xmlns:xacro=\"http://ros.org/wiki/xacro\"><xacro:a/></robot>";
    refused(template, 2, "expected an expanded URDF");
    let unsteered = TUGGER.replace(
        "name=\"steer_joint\" type=\"revolute\"",
        "name=\"steer_joint\" type=\"fixed\"",
    );
    refused(
        &unsteered,
        2,
        "wheels of several axles: rear_left_wheel_joint at x -0.400 m",
    );
    let unpowered = TUGGER.replace("name=\"velocity\"", "name=\"temperature\"");
    refused(&unpowered, 2, "the model is missing: give --model");
    let missing = folder.path().join("none.urdf");
    let output = calibrate(&robot, &["--urdf", missing.to_str().unwrap()]);
    assert_refused(&output, 74, "cannot read");
}
