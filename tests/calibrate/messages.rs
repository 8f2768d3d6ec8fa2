//! Recordings of robots that send other messages than `AckermannDriveStamped` and `LaserScan`.

use std::fs;
use std::path::{Path, PathBuf};

use fleetcal_tests::rewritten::{DriveAs, JOINTS, driven, posed, renamed, together};
use fleetcal_tests::{binary, recording};
use serde_json::Value;
use tempfile::TempDir;

use super::{assert_refused, calibrate};

fn recorded(folder: &TempDir, duration_s: f64) -> PathBuf {
    let path = folder.path().join("robot.mcap");
    recording::simulated(&path, duration_s);
    path
}

/// Returns the report without its machine-dependent part.
fn calibrated(recording: &Path, more: &[&str]) -> Value {
    let recording = recording.to_str().unwrap();
    let fixed = ["calibrate", recording, "--wheelbase", "1.2", "--json"];
    let mut report = binary::run_json(fixed.iter().chain(more));
    report.as_object_mut().unwrap().remove("timing");
    report
}

#[test]
fn a_recording_with_the_former_topic_gives_the_same_numbers() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 30.0);
    let former = folder.path().join("former.mcap");
    renamed(
        &path,
        &former,
        "/tugger_01/wheel_odometry",
        "/tugger_01/drive",
    );
    let expected = calibrated(&path, &[]);
    assert_eq!(calibrated(&former, &[]), expected);
    // The flag of that time is read as well.
    let flags = ["--drive-topic", "/tugger_01/drive"];
    assert_eq!(calibrated(&former, &flags), expected);
}

#[test]
fn joints_odometry_and_twist_give_the_numbers_of_one_message() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 30.0);
    let expected = calibrated(&path, &[]);
    let other = |how: DriveAs| {
        let to = folder.path().join(format!("{how:?}.mcap"));
        driven(&path, &to, how);
        to
    };
    // Ten of them in a message, found by its type.
    let ten = folder.path().join("ten.mcap");
    together(&path, &ten);
    assert_eq!(calibrated(&ten, &[]), expected);
    // All in one message, or in two of the same stamp: to the last digit.
    let joints = other(DriveAs::Joints);
    let flags = [
        "--wheel-odometry-topic",
        "/tugger_01/joint_states",
        "--joints",
        JOINTS,
    ];
    assert_eq!(calibrated(&joints, &flags), expected);
    let halves = other(DriveAs::JointsAndOdometry);
    let flags = [
        "--steering-topic",
        "/tugger_01/joint_states",
        "--speed-topic",
        "/tugger_01/odom",
        "--joints",
        JOINTS,
    ];
    assert_eq!(calibrated(&halves, &flags), expected);

    // As the service is told: by the robot's configuration.
    let config = folder.path().join("fleetcal.toml");
    let known = format!(
        "[[robot]]\nid = \"tugger_01\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n\
         [robot.streams]\nsteering = {{ topic = \"joint_states\", type = \
         \"sensor_msgs/msg/JointState\" }}\nspeed = {{ topic = \"odom\" }}\njoints = {JOINTS}\n"
    );
    fs::write(&config, &known).unwrap();
    let flags = ["--config", config.to_str().unwrap()];
    assert_eq!(calibrated(&halves, &flags), expected);

    // Stamps of their own, and half as many angles: the same within what the steps of the encoder
    // and the interpolation are worth.
    fs::write(&config, known.replace("\"odom\"", "\"twist\"")).unwrap();
    let slow = calibrated(&other(DriveAs::SlowJointsAndTwist), &flags);
    for name in ["steering_offset", "lidar_x", "lidar_y", "lidar_yaw"] {
        let of = |report: &Value, what: &str| report["parameters"][name][what].as_f64().unwrap();
        let apart = (of(&slow, "value") - of(&expected, "value")).abs();
        let sigma = of(&expected, "sigma");
        assert!(apart < sigma, "{name}: {apart} apart, sigma {sigma}");
    }
}

#[test]
fn a_lidar_pose_is_taken_from_both_messages() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("poses.mcap");
    posed(&recorded(&folder, 20.0), &path);
    let odometry = calibrated(&path, &[]);
    assert_eq!(
        odometry["scans"].as_u64().map(|scans| scans > 150),
        Some(true)
    );
    let pose = calibrated(&path, &["--pose-topic", "/tugger_01/lidar_pose"]);
    assert_eq!(pose, odometry);
}

#[test]
fn pairing_is_reported_and_what_is_missing_is_named() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("halves.mcap");
    driven(&recorded(&folder, 3.0), &path, DriveAs::SlowJointsAndTwist);
    let steering = ["--steering-topic", "/tugger_01/joint_states"];
    let speed = ["--speed-topic", "/tugger_01/twist"];
    let all = |more: &[&str]| {
        let flags = ["--wheelbase", "1.2"];
        calibrate(&path, &[&flags, more].concat())
    };
    let joints = ["--joints", JOINTS];
    let output = all(&[steering, speed, joints].concat());
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    assert!(
        said.contains("speeds paired") && said.contains("5.0 ms at most"),
        "{said}"
    );

    assert_refused(&all(&[]), 65, "--steering-topic and --speed-topic");
    assert_refused(&all(&steering), 2, "--steering-topic alone is given");
    let said = "streams.joints says which joints";
    assert_refused(&all(&[steering, speed].concat()), 65, said);
    let scan = ["--speed-topic", "/tugger_01/scan"];
    assert_refused(&all(&[steering, scan].concat()), 2, "nav_msgs/msg/Odometry");
    let wrong = ["--joints", "{ steering = '' }"];
    let output = all(&[steering, speed, wrong].concat());
    assert_eq!(output.status.code(), Some(2));
    let unknown = ["--joints", "{ steering = 'front' }"];
    let said = "lacks the joint \"front\"";
    assert_refused(&all(&[steering, speed, unknown].concat()), 65, said);
}
