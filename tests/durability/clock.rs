//! A wall clock that is set while the service runs: it goes on, and nothing young is deleted.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use fleetcal_tests::service::{Service, wait_for};
use serde_json::Value;
use tempfile::TempDir;

use crate::durability::lifecycle::{Fleet, received};

/// Robots that drive meanwhile, and the duration, s.
const ROBOTS: usize = 2;
const DRIVE_S: u64 = 60;
const DAY_S: i64 = 86_400;
/// Offsets of the clock from the machine's, one after another, with the reasons.
const AHEAD: [(i64, &str); 5] = [
    (30 * DAY_S, "30 days later"),
    (-30 * DAY_S, "30 days before"),
    (0, "right again"),
    (20 * 366 * DAY_S, "after the year 2038"),
    (0, "right again"),
];

/// Wall clock of a service, which a test sets.
struct WallClock {
    folder: TempDir,
}

impl WallClock {
    fn new() -> Self {
        let clock = Self {
            folder: TempDir::new().unwrap(),
        };
        let source = concat!(env!("CARGO_MANIFEST_DIR"), "/durability/clock_step.c");
        let built = Command::new("cc")
            .args(["-shared", "-fPIC", "-O1", "-o"])
            .arg(clock.path("clock_step.so"))
            .arg(source)
            .status();
        assert!(built.unwrap().success(), "the C compiler that SQLite needs");
        fs::write(clock.path("ahead"), 0_i64.to_ne_bytes()).unwrap();
        clock
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Sets the clock; written in place, since the service has mapped the file.
    fn set(&self, ahead_s: i64) {
        use std::os::unix::fs::FileExt;
        let file = fs::OpenOptions::new()
            .write(true)
            .open(self.path("ahead"))
            .unwrap();
        file.write_all_at(&ahead_s.to_ne_bytes(), 0).unwrap();
    }

    fn service(&self) -> Service {
        Service::start_with_variables(&[
            ("LD_PRELOAD", self.path("clock_step.so").to_str().unwrap()),
            ("CLOCK_STEP_FILE", self.path("ahead").to_str().unwrap()),
        ])
    }
}

/// Returns the seconds in the last hour of the first robot's history, by its own clock.
fn history(service: &Service) -> usize {
    let history: Value = service.get("/api/v1/robots/robot_01/history?max_points=5000");
    let seconds = history["time"].as_array().unwrap().len();
    if history["bucket_s"] == 1 { seconds } else { 0 }
}

#[test]
fn a_clock_that_is_set_stops_nothing_and_deletes_nothing() {
    let clock = WallClock::new();
    let mut service = clock.service();
    let vehicle = r#"{"model":"bicycle","wheelbase_m":1.2}"#;
    for number in 1..=ROBOTS {
        service.register(&format!("robot_{number:02}"), vehicle);
    }
    let _fleet = Fleet::drives(&service, ROBOTS, DRIVE_S);
    wait_for("history", || (history(&service) > 2).then_some(()));
    let mut steps = 0;
    for (ahead_s, what) in AHEAD {
        let (rows, messages) = (history(&service), received(&service));
        clock.set(ahead_s);
        wait_for(what, || (received(&service) > messages + 100).then_some(()));
        for path in ["/healthz", "/readyz"] {
            assert_eq!(service.status(path, None), 200, "{path}, {what}");
        }
        steps += 1;
        service.register(&format!("added_{steps}"), vehicle);
        wait_for("more history", || (history(&service) > rows).then_some(()));
        println!("{what}: {rows} rows before, {} after", history(&service));
    }
    assert_eq!(service.metric("fleetcal_store_lost_total"), 0);
    service.kill();
    service.restart();
    for step in 1..=steps {
        let robot = format!("added_{step}");
        assert_eq!(service.robot(&robot)["id"], robot.as_str());
    }
}
