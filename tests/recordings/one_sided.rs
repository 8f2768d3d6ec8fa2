//! A real car that turns to one side alone: what it claims of y and yaw is true at any time.

use fleetcal_tests::{binary, recording};
use tempfile::TempDir;

use crate::recordings::recorded::Recorded;

/// Interval at which claims are checked, ns.
const EVERY_NS: u64 = 5_000_000_000;
/// Largest error of a claim, in its sigmas.
const SIGMAS: f64 = 4.0;
/// Values of a tape measure and of a fit of the whole recording, with their tolerances: m, rad.
const REFERENCE: [(&str, f64, f64); 2] =
    [("lidar_y", -0.010, 0.005), ("lidar_yaw", -0.0077, 0.004)];

/// Checks a 1:10 car at 0.4 m/s that turns right for 142 s. Its offset, its speed scale and the
/// LiDAR's y trade off.
#[test]
fn a_real_car_that_turns_right_claims_no_false_y_or_yaw() {
    let Some(path) = recording::named("dart_right.mcap") else {
        return;
    };
    let (recorded, folder) = (Recorded::read(&path), TempDir::new().unwrap());
    let (mut looked, mut claimed) = (0, 0);
    for until_ns in (EVERY_NS..recorded.length_ns + EVERY_NS).step_by(EVERY_NS as usize) {
        let part = folder.path().join("part.mcap");
        recorded.write(&part, 0..until_ns + 1);
        let part = part.to_str().unwrap();
        let report = binary::run_json(["calibrate", part, "--wheelbase", "0.1735", "--json"]);
        for (name, reference, known_to) in REFERENCE {
            let found = &report["parameters"][name];
            let number = |key: &str| found[key].as_f64().unwrap();
            looked += 1;
            if found["status"] != "converged" {
                continue;
            }
            claimed += 1;
            let off = (number("value") - reference).abs();
            assert!(
                off <= (SIGMAS * number("sigma")).hypot(known_to),
                "{name} after {} s: {found}",
                until_ns / 1_000_000_000
            );
        }
    }
    assert!(looked > 50, "looked {looked} times");
    // None may be: offset, speed scale and y trade off.
    eprintln!("converged at {claimed} of {looked} looks");
}
