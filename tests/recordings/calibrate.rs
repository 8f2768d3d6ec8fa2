//! `fleetcal calibrate` held to its figures.

use fleetcal_tests::report::assert_near;
use fleetcal_tests::{binary, recording};

#[test]
fn the_figure_eight_meets_its_figures() {
    let Some(path) = recording::named("figure_eight.mcap") else {
        return;
    };
    let path = path.to_str().unwrap();
    let report = binary::run_json(["calibrate", path, "--wheelbase", "1.2", "--json"]);
    let cases = [
        (
            "steering_offset",
            2.92_f64.to_radians(),
            0.02_f64.to_radians(),
        ),
        ("lidar_x", 0.438, 0.002),
        ("lidar_y", -0.016, 0.002),
        ("lidar_yaw", 0.76_f64.to_radians(), 0.03_f64.to_radians()),
    ];
    assert_near(&report, &cases, 3.0, [0.0; 2]);
}

#[test]
fn the_real_tricycle_meets_its_figures() {
    let Some(path) = recording::named("sapienza_tricycle.mcap") else {
        return;
    };
    let path = path.to_str().unwrap();
    let vehicle = ["--model", "tricycle", "--wheelbase", "1.54757"];
    let report = binary::run_json(["calibrate", path, "--json"].iter().chain(&vehicle));
    let degree = 1.0_f64.to_radians();
    let cases = [
        ("steering_offset", 0.0559, degree),
        ("lidar_x", 1.810, 0.03),
        ("lidar_y", -0.023, 0.04),
        ("lidar_yaw", -0.002, degree),
    ];
    assert_near(&report, &cases, 4.0, [0.010, 0.02]);
    let events = report["events"].as_array().unwrap();
    assert!(events.is_empty(), "nothing failed or moved: {events:?}");
}
