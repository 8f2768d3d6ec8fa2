//! Recordings replayed into a running service, and held against `calibrate`.

use std::path::Path;

use fleetcal_proto::RobotId;
use fleetcal_robot::replay::{Rate, ReplayOptions, ReplaySummary, replay};
use serde_json::Value;

use crate::binary;
use crate::service::Service;

/// Makes a robot that replays a recording as fast as the service processes it.
///
/// # Panics
/// When `robot` is not a robot id.
pub fn sender(service: &Service, path: &Path, robot: &str) -> ReplayOptions {
    let mut options = ReplayOptions::new(path.to_owned(), vec![service.endpoint()]);
    options.robot = Some(RobotId::parse(robot).expect("what the test needs"));
    options.rate = Rate::Max;
    options
}

/// Sends a recording, and waits for its end.
///
/// # Panics
/// When it cannot be sent.
pub async fn send(options: ReplayOptions) -> ReplaySummary {
    replay(options, |_| {}).await.expect("what the test needs")
}

/// Returns the report of `calibrate` on a recording of a vehicle with a wheelbase of 1.2 m.
///
/// # Panics
/// When it refuses the recording.
pub fn calibrated(path: &Path) -> Value {
    binary::run_json([
        "calibrate",
        path.to_str().expect("what the test needs"),
        "--wheelbase",
        "1.2",
        "--json",
    ])
}

/// Asserts that the service's last estimate and the report of `calibrate` are the same numbers.
///
/// # Panics
/// When they are not.
pub fn assert_same(estimate: &Value, report: &Value) {
    for name in ["parameters", "consistency", "distance_m"] {
        assert_eq!(estimate[name], report[name], "{name}");
    }
    assert_eq!(estimate["time_s"], report["duration_s"]);
    assert_eq!(estimate["counts"]["scans"], report["scans"]);
}

/// Asserts that a service agrees with `calibrate` on a replayed recording, and loses nothing.
///
/// # Panics
/// When it does not.
pub async fn replay_equals_calibrate(path: &Path, robot: &str) {
    let service = Service::start(&[robot]);
    let summary = send(sender(&service, path, robot)).await;
    assert_eq!((summary.dropped, summary.unconfirmed), (0, 0));
    let estimate = service.estimate_of(robot, summary.drive_samples);
    assert_same(&estimate, &calibrated(path));
    let counters = service.accounts_of(robot);
    assert_eq!(counters["received"], summary.drive_samples + summary.scans);
    assert_eq!(counters["processed"], counters["received"]);
}
