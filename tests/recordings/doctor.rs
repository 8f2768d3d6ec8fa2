//! `fleetcal doctor` on recordings whose inputs are right: it names nothing, and names what is told
//! wrongly.

use std::process::Output;

use fleetcal_tests::{binary, recording};
use serde_json::Value;

/// Runs the checks; none when the recording is not there.
fn doctor(file: &str, flags: &[&str]) -> Option<(Output, Value)> {
    let path = recording::named(file)?;
    let path = path.to_str().unwrap();
    let output = binary::run(["doctor", path, "--json"].iter().chain(flags));
    let report = serde_json::from_slice(&output.stdout).unwrap();
    Some((output, report))
}

/// Names of the causes that are named.
fn causes(report: &Value) -> Vec<&str> {
    let findings = report["findings"].as_array().unwrap();
    findings
        .iter()
        .filter_map(|finding| finding["cause"].as_str())
        .collect()
}

/// The recordings with wheel odometry, and the vehicles that they are of.
const RIGHT: [(&str, &[&str]); 4] = [
    ("figure_eight.mcap", &["--wheelbase", "1.2"]),
    ("remounted.mcap", &["--wheelbase", "1.2"]),
    (
        "sapienza_tricycle.mcap",
        &["--wheelbase", "1.54757", "--model", "tricycle"],
    ),
    ("dart_right.mcap", &["--wheelbase", "0.1735"]),
];

#[test]
fn nothing_is_named_of_recordings_that_are_right() {
    for (file, vehicle) in RIGHT {
        let Some((output, report)) = doctor(file, vehicle) else {
            return;
        };
        assert!(causes(&report).is_empty(), "{file}: {report}");
        assert_eq!(output.status.code(), Some(0), "{file}");
        let way_m = report["way_m"].as_f64().unwrap();
        assert!(way_m > 20.0, "{file}: {way_m} m");
        let cpu = |name: &str| report[name].as_f64().unwrap();
        println!(
            "{file}: checks {:.3} s, LiDAR odometry {:.3} s",
            cpu("checks_cpu_s"),
            cpu("odometry_cpu_s")
        );
    }
}

#[test]
fn a_vehicle_that_is_described_wrongly_is_named() {
    for (file, vehicle, wanted) in [
        (
            "figure_eight.mcap",
            &["--wheelbase", "1.8"][..],
            "wheelbase",
        ),
        (
            "sapienza_tricycle.mcap",
            &["--wheelbase", "1.54757"],
            "tricycle",
        ),
        (
            "sapienza_tricycle.mcap",
            &["--wheelbase", "2.3", "--model", "tricycle"],
            "wheelbase",
        ),
    ] {
        let Some((output, report)) = doctor(file, vehicle) else {
            return;
        };
        assert_eq!(causes(&report), [wanted], "{file}: {report}");
        assert_eq!(output.status.code(), Some(1), "{file}");
    }
}
