//! `fleetcal simulate --imperfections`: the recording, its truth, and files that are refused.

use std::fs;

use fleetcal_robot::fleet::{RecordedTruth, truth_path};
use fleetcal_robot::simulator::Imperfections;
use fleetcal_tests::binary;
use tempfile::TempDir;

use super::{assert_refused, calibrate};

const SECONDS: [&str; 2] = ["--duration", "20"];

#[test]
fn a_recording_of_an_imperfect_robot_names_what_is_wrong_with_it() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("imperfect.mcap");
    let file = folder.path().join("imperfections.toml");
    let text =
        "[vehicle]\nsteering_gain = 0.02\nwheelbase = 0.02\n[scanner]\nstamped_at_end = true\n";
    fs::write(&file, text).unwrap();
    let [recorded, given] = [&path, &file].map(|path| path.to_str().unwrap());
    let flags = ["simulate", "--record", recorded, "--imperfections", given];
    let output = binary::run(flags.iter().chain(&SECONDS));
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.success() && said.contains("wheelbase 1.224 m"),
        "{output:?}"
    );

    let truth = fs::read(truth_path(&path)).unwrap();
    let truth: RecordedTruth = serde_json::from_slice(&truth).unwrap();
    let mut expected = Imperfections::default();
    expected.vehicle.steering_gain = 0.02;
    expected.vehicle.wheelbase = 0.02;
    expected.scanner.stamped_at_end = true;
    assert_eq!(truth.imperfections, expected);
    assert_eq!(truth.parameters.steering_gain, Some(1.02));
    // The robot is one that can be calibrated.
    let found = calibrate(&path, &["--wheelbase", "1.224", "--json"]);
    assert!(found.status.success(), "{found:?}");
}

#[test]
fn a_file_with_a_key_that_is_not_one_is_refused_in_one_sentence() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("imperfections.toml");
    let path = folder.path().join("never.mcap");
    let [recorded, given] = [&path, &file].map(|path| path.to_str().unwrap());
    let flags = ["simulate", "--record", recorded, "--imperfections", given];
    for (text, wanted) in [
        (
            "[vehicle]\nbacklash_deg = 0.5\n",
            "line 2: unknown field `backlash_deg`",
        ),
        (
            "[clocks]\nlost_messages = 1.5\n",
            "imperfections.clocks.lost_messages",
        ),
    ] {
        fs::write(&file, text).unwrap();
        assert_refused(&binary::run(flags), 2, wanted);
        assert!(!path.exists(), "nothing is recorded");
    }
}

/// Returns the remarks of `calibrate` beside the result of a minute's recording of a robot with
/// these imperfections.
fn told(imperfections: &str) -> String {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("recorded.mcap");
    let file = folder.path().join("imperfections.toml");
    fs::write(&file, imperfections).unwrap();
    let [recorded, given] = [&path, &file].map(|path| path.to_str().unwrap());
    let flags = ["simulate", "--record", recorded, "--imperfections", given];
    let output = binary::run(flags.iter().chain(&["--duration", "60"]));
    assert!(output.status.success(), "{output:?}");
    let output = calibrate(&path, &["--wheelbase", "1.2", "--json"]);
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stderr).unwrap()
}

/// Returns the number that follows a phrase.
fn number_after(said: &str, phrase: &str) -> f64 {
    let (_, rest) = said.split_once(phrase).unwrap();
    rest.split(' ').next().unwrap().parse().unwrap()
}

#[test]
fn a_turning_scanner_without_beam_times_is_told_and_estimated() {
    let said = told("[scanner]\nuntimed_beams = true\n");
    assert!(
        said.contains("time_increment 0, but the scanner turns"),
        "{said}"
    );
    let duration_ms = number_after(&said, "a scan takes ");
    assert!(
        (duration_ms - 100.0).abs() < 5.0,
        "{duration_ms} ms of 100 ms"
    );
    let said = told("[scanner]\nuntimed_beams = false\n");
    assert!(!said.contains("time_increment"), "{said}");
    assert!(!said.contains("the LiDAR sees the floor"), "{said}");
}

#[test]
fn where_a_tilted_scanner_sees_the_floor_is_told() {
    let said = told("[scanner]\ntilt_rad = 0.02\ntilt_direction_rad = 0.5236\n");
    let distance_m = number_after(&said, "the LiDAR sees the floor ");
    assert!((distance_m - 10.0).abs() < 0.2, "{said}");
    assert!(said.contains("30 degrees in its frame"), "{said}");
}
