//! `fleetcal calibrate` and `fleetcal odometry` as a person or a script calls them.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod bags;
mod doctor;
mod imperfect;
mod known_map;
mod messages;
mod recorded;
mod wheel;
mod written;

use std::fs;
use std::path::Path;
use std::process::Output;

use fleetcal_proto::estimate::CalibrationReport;
use fleetcal_tests::report::assert_near;
use fleetcal_tests::rewritten::Rewritten;
use fleetcal_tests::{binary, clouds, recording, rewritten};
use tempfile::TempDir;

/// Asserts one sentence on standard error that contains `wanted`, and the exit status.
fn assert_refused(output: &Output, status: i32, wanted: &str) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(status), "{said}");
    assert_eq!(said.trim_end().lines().count(), 1, "one sentence: {said}");
    assert!(said.contains(wanted), "{wanted:?} is not in {said:?}");
    assert!(
        output.stdout.is_empty(),
        "nothing is printed beside the sentence"
    );
}

fn calibrate(path: &Path, more: &[&str]) -> Output {
    let path = path.to_str().unwrap();
    binary::run(["calibrate", path].iter().chain(more))
}

#[test]
fn a_simulated_recording_is_calibrated_to_its_truth() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("robot.mcap");
    let truth = recording::simulated(&path, 90.0);
    let wheelbase = truth.vehicle.wheelbase_m.to_string();
    let path = path.to_str().unwrap();
    let report = binary::run_json(["calibrate", path, "--wheelbase", &wheelbase, "--json"]);
    let truth = truth.parameters;
    let cases = [
        (
            "steering_offset",
            truth.steering_offset_rad,
            0.03_f64.to_radians(),
        ),
        ("lidar_x", truth.lidar_x_m, 0.004),
        ("lidar_y", truth.lidar_y_m, 0.004),
        ("lidar_yaw", truth.lidar_yaw_rad, 0.04_f64.to_radians()),
    ];
    assert_near(&report, &cases, 4.0, [0.0; 2]);
    assert_eq!(report["robot"], "tugger_01");
    assert_eq!(report["schema_version"], 2);
    assert!(report["timing"]["realtime_factor"].as_f64().unwrap() > 1.0);
    let report: CalibrationReport = serde_json::from_value(report).unwrap();
    for (name, parameter) in report.parameters.iter() {
        let terms = report.sigma_terms.get(&name).map_or(&[][..], Vec::as_slice);
        let folded = terms.iter().fold(0.0, |sigma, term| term.applied_to(sigma));
        let apart = (folded - parameter.sigma).abs();
        assert!(
            apart <= 1e-9 * parameter.sigma,
            "{name:?}: {terms:?} of {parameter:?}"
        );
    }
}

#[test]
fn the_clouds_of_a_3d_scanner_are_calibrated_to_their_truth() {
    let folder = TempDir::new().unwrap();
    let planar = folder.path().join("robot.mcap");
    let truth = recording::simulated(&planar, 60.0);
    let path = folder.path().join("clouds.mcap");
    clouds::of_scans(&planar, &path);
    let wheelbase = truth.vehicle.wheelbase_m.to_string();
    let path = path.to_str().unwrap();
    let flags = ["--wheelbase", &wheelbase, "--height-band", "-0.4,1"];
    let report = binary::run_json(["calibrate", path, "--json"].iter().chain(&flags));
    assert_eq!(report["scans_rejected"], 0);
    let truth = truth.parameters;
    let cases = [
        ("steering_offset", truth.steering_offset_rad, 0.0015),
        ("lidar_x", truth.lidar_x_m, 0.006),
        ("lidar_y", truth.lidar_y_m, 0.006),
        ("lidar_yaw", truth.lidar_yaw_rad, 0.0015),
    ];
    assert_near(&report, &cases, 5.0, [0.0; 2]);
}

#[test]
fn a_table_and_trajectories_are_what_a_person_reads() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("robot.mcap");
    recording::simulated(&path, 20.0);
    let tum = folder.path().join("base.tum");
    let output = calibrate(
        &path,
        &["--wheelbase", "1.2", "--trajectory", tum.to_str().unwrap()],
    );
    let table = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && output.stderr.is_empty());
    assert!(
        table.contains("steering offset") && table.contains("LiDAR yaw"),
        "{table}"
    );
    let lines = fs::read_to_string(&tum).unwrap();
    assert!(lines.lines().count() > 50 && lines.lines().all(|line| line.split(' ').count() == 8));

    let path = path.to_str().unwrap();
    let tum = folder.path().join("lidar.tum");
    let arguments = [
        "odometry",
        path,
        "--json",
        "--trajectory",
        tum.to_str().unwrap(),
    ];
    let summary = binary::run_json(arguments);
    let poses = fs::read_to_string(&tum).unwrap().lines().count() as u64;
    assert_eq!(summary["scans"], poses);
    assert_eq!(summary["tracking"]["lost"], 0);
}

#[test]
fn what_cannot_be_read_is_refused_in_one_sentence() {
    let folder = TempDir::new().unwrap();
    let vehicle = ["--wheelbase", "1.2"];
    let missing = folder.path().join("missing.mcap");
    assert_refused(&calibrate(&missing, &vehicle), 74, "missing.mcap");
    let empty = folder.path().join("empty.mcap");
    fs::write(&empty, b"").unwrap();
    assert_refused(&calibrate(&empty, &vehicle), 65, "empty");
    let text = folder.path().join("text.mcap");
    fs::write(&text, b"this is a letter, not a recording").unwrap();
    assert_refused(&calibrate(&text, &vehicle), 65, "no MCAP file");
    let whole = folder.path().join("whole.mcap");
    recording::simulated(&whole, 3.0);
    let bytes = fs::read(&whole).unwrap();
    let cut = folder.path().join("cut.mcap");
    fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    assert_refused(&calibrate(&cut, &vehicle), 65, "truncated");
}

#[test]
fn what_the_caller_can_mend_is_said_with_its_flag() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("robot.mcap");
    recording::simulated(&path, 3.0);
    assert_refused(&calibrate(&path, &[]), 2, "--wheelbase");
    for wheelbase in ["0", "-1.2", "nan", "inf", "31"] {
        assert_refused(
            &calibrate(&path, &["--wheelbase", wheelbase]),
            2,
            "more than 0",
        );
    }
    for robot in ["a*b", "a/b", ""] {
        let flags = ["--wheelbase", "1.2", "--robot", robot];
        assert_refused(&calibrate(&path, &flags), 2, "--robot");
    }
    let flags = [
        "--wheelbase",
        "1.2",
        "--wheel-odometry-topic",
        "/tugger_01/scan",
    ];
    assert_refused(&calibrate(&path, &flags), 2, "--wheel-odometry-topic");
    let config = folder.path().join("fleetcal.toml");
    fs::write(&config, "[estimator]\nnoize = 1\n").unwrap();
    let flags = ["--wheelbase", "1.2", "--config", config.to_str().unwrap()];
    assert_refused(&calibrate(&path, &flags), 2, "noize");
}

#[test]
fn a_recording_without_drive_or_scans_says_what_is_missing() {
    let folder = TempDir::new().unwrap();
    let [whole, path] = ["whole.mcap", "less.mcap"].map(|name| folder.path().join(name));
    recording::simulated(&whole, 3.0);
    let without = |left_out: &str| {
        rewritten::rewritten(&whole, &path, |message_type, of| {
            let kept = message_type != left_out;
            let kept = kept.then(|| Rewritten::unchanged(message_type, of));
            kept.into_iter().collect()
        });
    };
    without("ackermann_msgs/msg/AckermannDriveStamped");
    assert_refused(
        &calibrate(&path, &["--wheelbase", "1.2"]),
        65,
        "no wheel odometry topic",
    );
    without("sensor_msgs/msg/LaserScan");
    let out = folder.path().join("none.tum");
    let [path, out] = [&path, &out].map(|path| path.to_str().unwrap());
    let arguments = ["odometry", path, "--trajectory", out];
    assert_refused(&binary::run(arguments), 65, "no scan topic");
}
