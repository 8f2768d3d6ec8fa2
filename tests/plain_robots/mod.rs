//! The robots in `examples/`, against the real service.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::env;
use std::path::Path;
use std::process::{Child, Command};

use fleetcal_tests::binary;
use fleetcal_tests::service::Service;
use serde_json::Value;

/// Duration of each robot's drive, s of its own time, and its speed relative to real time.
const DRIVE: [&str; 2] = ["60", "6"];
/// True values built into the examples.
const TRUTH: [(&str, f64, f64); 4] = [
    ("steering_offset", 0.03, 0.003),
    ("lidar_x", 0.4, 0.01),
    ("lidar_y", 0.1, 0.01),
    ("lidar_yaw", 0.05, 0.005),
];

fn assert_found(estimate: &Value) {
    for (name, truth, tolerance) in TRUTH {
        let value = estimate["parameters"][name]["value"].as_f64().unwrap();
        eprintln!("{name}: {value:.4}, true {truth}");
        assert!((value - truth).abs() < tolerance, "{name}: {estimate}");
    }
}

/// Starts a robot's program as `robot`, and waits until it has driven to the end.
fn drive(mut program: Command, service: &Service, robot: &str) {
    let started = program.arg(service.endpoint()).arg(robot).args(DRIVE);
    let mut child: Child = started.spawn().unwrap();
    let status = child.wait().unwrap();
    assert!(status.success(), "{status}");
    let counters = service.accounts_of(robot);
    assert_eq!(counters["refused"], 0, "{counters}");
    let samples = counters["drive_samples"].as_u64().unwrap();
    assert!(samples > 5_000, "{counters}");
    assert_found(&service.get(&format!("/api/v1/robots/{robot}/estimate")));
}

#[test]
fn the_rust_robot_is_calibrated() {
    let service = Service::start(&["rust_robot"]);
    let program = binary::path().with_file_name("fleetcal-example-robot");
    drive(Command::new(program), &service, "rust_robot");
}

#[test]
fn the_python_robot_is_calibrated() {
    let Some(python) = env::var_os("FLEETCAL_PYTHON").filter(|path| !path.is_empty()) else {
        eprintln!("skipped: FLEETCAL_PYTHON is not set; `make test` sets it");
        return;
    };
    let service = Service::start(&["python_robot"]);
    let mut program = Command::new(python);
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    program.arg(root.join("examples/python/robot.py"));
    drive(program, &service, "python_robot");
}
