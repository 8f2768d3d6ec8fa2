//! `fleetcal doctor` from outside: what it prints, and its exit statuses.

use std::path::Path;

use fleetcal_tests::binary;
use serde_json::Value;
use tempfile::TempDir;

/// Records a robot with wrong inputs, and runs the checks: exit status, and the document.
fn doctor(folder: &Path, wrong: &str) -> (Option<i32>, Value) {
    let path = folder.join(format!("drive_{wrong}.mcap"));
    let path = path.to_str().unwrap();
    let mut simulate = vec!["simulate", "--record", path, "--duration", "45"];
    if !wrong.is_empty() {
        simulate.extend(["--wrong", wrong]);
    }
    let recorded = binary::run(&simulate);
    assert!(recorded.status.success(), "{recorded:?}");
    let words = String::from_utf8(recorded.stdout).unwrap();
    let wheelbase = words.split("wheelbase ").nth(1).unwrap();
    let wheelbase = wheelbase.split(' ').next().unwrap();
    let output = binary::run(["doctor", path, "--json", "--wheelbase", wheelbase]);
    let document = serde_json::from_slice(&output.stdout).unwrap();
    (output.status.code(), document)
}

fn causes(report: &Value) -> Vec<&str> {
    let findings = report["findings"].as_array().unwrap();
    findings
        .iter()
        .filter_map(|finding| finding["cause"].as_str())
        .collect()
}

#[test]
fn wrong_inputs_are_named_and_right_ones_are_not() {
    let folder = TempDir::new().unwrap();
    let (status, report) = doctor(folder.path(), "");
    assert_eq!((status, causes(&report)), (Some(0), vec![]), "{report}");
    let streams = report["streams"].as_array().unwrap();
    assert_eq!(streams.len(), 2);
    assert_eq!(streams[1]["frames"], serde_json::json!(["lidar"]));
    for (wrong, named) in [
        ("steering_sign", &["steering_sign"][..]),
        ("degrees", &["refused", "steering_degrees"]),
        ("mirrored_scan,km_h", &["speed_unit", "steering_sign"]),
        ("time_zone", &["stamps_apart"]),
        ("two_frames", &["several_frames"]),
    ] {
        let (status, report) = doctor(folder.path(), wrong);
        assert_eq!(
            (status, causes(&report)),
            (Some(1), named.to_vec()),
            "{wrong}: {report}"
        );
    }
}

#[test]
fn what_is_no_recording_is_status_65_and_no_wheelbase_2() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("torn.mcap");
    std::fs::write(&path, b"nothing").unwrap();
    let status = |path: &Path, flags: &[&str]| {
        let arguments = ["doctor", path.to_str().unwrap()];
        binary::run(arguments.iter().chain(flags)).status.code()
    };
    assert_eq!(status(&path, &["--wheelbase", "1.2"]), Some(65));
    let recorded = folder.path().join("drive.mcap");
    let simulated = [
        "simulate",
        "--record",
        recorded.to_str().unwrap(),
        "--duration",
        "2",
    ];
    assert!(binary::run(simulated).status.success());
    assert_eq!(status(&recorded, &[]), Some(2));
}
