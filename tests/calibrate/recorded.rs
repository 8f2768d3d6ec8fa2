//! `fleetcal simulate --record`: recordings of one robot that follow one another, and of one that was knocked.

use std::fs;
use std::path::Path;

use fleetcal_robot::fleet::{RecordedTruth, truth_path};
use fleetcal_tests::binary;
use tempfile::TempDir;

use super::assert_refused;

/// Records two seconds of a robot with these flags; gives its truth.
fn recorded(folder: &Path, flags: &[&str]) -> RecordedTruth {
    let path = folder.join("recorded.mcap");
    let recorded = path.to_str().unwrap();
    let command = ["simulate", "--record", recorded, "--duration", "2"];
    let output = binary::run(command.iter().chain(flags));
    assert!(output.status.success(), "{output:?}");
    serde_json::from_slice(&fs::read(truth_path(&path)).unwrap()).unwrap()
}

#[test]
fn a_recording_begins_when_it_is_told_to_with_the_lidar_turned() {
    let folder = TempDir::new().unwrap();
    let first = recorded(folder.path(), &[]);
    assert_eq!(first.start_stamp_ns, 1_760_000_000_000_000_000);
    let flags = ["--start-stamp", "1760000300", "--turn-lidar", "-1.2"];
    let later = recorded(folder.path(), &flags);
    assert_eq!(later.start_stamp_ns, 1_760_000_300_000_000_000);
    let turned_rad = later.parameters.lidar_yaw_rad - first.parameters.lidar_yaw_rad;
    assert!((turned_rad.to_degrees() + 1.2).abs() < 1e-9, "{turned_rad}");
    // It is the same robot otherwise.
    let mut turned_back = later.parameters;
    turned_back.lidar_yaw_rad = first.parameters.lidar_yaw_rad;
    assert_eq!(turned_back, first.parameters);
}

#[test]
fn what_no_message_can_carry_is_refused_in_one_sentence() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("never.mcap");
    let recorded = path.to_str().unwrap();
    for (flag, value, wanted) in [
        ("--start-stamp", "2147483647", "header.stamp: got"),
        ("--turn-lidar", "NaN", "lidar_in_base"),
    ] {
        let output = binary::run(["simulate", "--record", recorded, flag, value]);
        assert_refused(&output, 2, wanted);
    }
}
