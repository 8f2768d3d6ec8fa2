//! A service whose PostgreSQL is away for a while, with robots that drive on.

use std::process::{Child, Command, Stdio};
use std::time::Duration;

use fleetcal_contract::own_server::OwnServer;
use fleetcal_tests::service::{self, Service, wait_for};
use fleetcal_tests::{binary, database};
use serde_json::Value;
use tempfile::TempDir;

/// Names of `fleetcal simulate`'s robots.
const ROBOTS: [&str; 3] = ["tugger_01", "tugger_02", "tugger_03"];
/// Absence of the server.
const AWAY_FOR: Duration = Duration::from_secs(15);
/// Time within which decisions are refused meanwhile.
const REFUSED_WITHIN: Duration = Duration::from_secs(1);
/// Time within which the decision is refused that meets the loss itself.
const FIRST_REFUSED_WITHIN: Duration = Duration::from_secs(4);
/// Time after the server's return within which decisions are taken, and telemetry is written.
const AGAIN_WITHIN: Duration = Duration::from_secs(5);
/// Number of a decision that is refused, and taken afterwards.
const REFUSED: u32 = 1_000;
/// Metric of the processed scans.
const SCANS: &str = "fleetcal_estimator_scan_duration_seconds_count";

/// Simulated robots, which stop with this value.
struct Robots(Child);

impl Robots {
    fn drive(service: &Service) -> Self {
        let mut simulate = Command::new(binary::path());
        simulate.args(["simulate", "--robots", &ROBOTS.len().to_string()]);
        simulate.args(["--connect", &service.endpoint()]);
        simulate.stdout(Stdio::null()).stderr(Stdio::null());
        Self(simulate.spawn().unwrap())
    }
}

impl Drop for Robots {
    fn drop(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

/// Returns the path of a decision: a robot that is registered.
fn path(number: u32) -> String {
    format!("/api/v1/robots/decided_{number}")
}

/// Returns the answer to a decision: its status and problem.
fn decide(service: &Service, number: u32) -> (u16, String) {
    let config = serde_json::json!({"model": "bicycle", "wheelbase_m": 1.2});
    let answer = service.try_put(&path(number), &config).unwrap();
    (answer.status, answer.body)
}

/// Makes decisions until the server's last processes have noticed that their postmaster is gone;
/// returns the number of decisions that they acknowledged.
fn decided_until_gone(service: &Service) -> u32 {
    let killed = service::now();
    let mut number = 0;
    loop {
        let asked = service::now();
        let (status, told) = decide(service, number);
        if status >= 300 {
            let took = asked.elapsed();
            assert!(
                status == 503 && took < FIRST_REFUSED_WITHIN,
                "{took:?}: {told}"
            );
            return number;
        }
        number += 1;
        assert!(killed.elapsed() < AGAIN_WITHIN, "it still decides");
        // A process that always has something to read does not look for its postmaster.
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Returns the seconds of a robot's history, oldest first.
fn seconds_of(service: &Service, robot: &str) -> Option<Vec<String>> {
    let path = format!("/api/v1/robots/{robot}/history?parameter=lidar_x&max_points=5000");
    let times = service.try_get(&path)?["time"].as_array()?.clone();
    let text = |time: &Value| time.as_str().map(str::to_owned);
    times.iter().map(text).collect()
}

/// Asserts the behaviour of a service without its database, second after second.
fn assert_goes_on(service: &Service) {
    let (gone, mut scans) = (service::now(), service.metric(SCANS));
    while gone.elapsed() < AWAY_FOR {
        let asked = service::now();
        let (status, told) = decide(service, REFUSED);
        let took = asked.elapsed();
        assert!(
            status == 503 && took < REFUSED_WITHIN && told.contains("database_unavailable"),
            "{status} after {took:?}: {told}"
        );
        assert_eq!(service.status("/healthz", None), 200);
        std::thread::sleep(Duration::from_secs(1));
        let now = service.metric(SCANS);
        assert!(now > scans, "the estimators stand still at {now} scans");
        scans = now;
    }
    assert_eq!(service.status("/readyz", None), 503);
}

#[test]
fn estimators_go_on_without_the_database_which_gets_their_seconds_afterwards() {
    let server = OwnServer::start_new("trust");
    let folder = TempDir::new().unwrap();
    let data = folder.path().join("data");
    database::name(&data, &server.url("postgres"));
    let service = Service::start_with_data(&data);
    for robot in ROBOTS {
        service.register(robot, r#"{"model": "bicycle", "wheelbase_m": 1.2}"#);
    }
    let _robots = Robots::drive(&service);
    let before = wait_for("10 s of history", || {
        seconds_of(&service, ROBOTS[0]).filter(|seconds| seconds.len() >= 10)
    });
    server.kill();
    let acknowledged = decided_until_gone(&service);
    assert_goes_on(&service);
    server.start();
    let back = service::now();
    wait_for("a decision", || {
        (decide(&service, REFUSED).0 < 300).then_some(())
    });
    let decided = back.elapsed();
    wait_for("readiness", || {
        (service.status("/readyz", None) == 200).then_some(())
    });
    let enough = before.len() + AWAY_FOR.as_secs() as usize;
    wait_for("the seconds of the absence", || {
        seconds_of(&service, ROBOTS[0]).filter(|seconds| seconds.len() >= enough)
    });
    let written = back.elapsed();
    println!("a decision after {decided:?}, every second after {written:?}");
    assert!(written < AGAIN_WITHIN, "{decided:?}, {written:?}");
    for robot in ROBOTS {
        let seconds = wait_for("its history", || seconds_of(&service, robot));
        // One each: a gap would be a second that is missing.
        let [first, last] = [seconds.first(), seconds.last()].map(|time| second(time.unwrap()));
        assert_eq!(
            last - first + 1,
            seconds.len() as i64,
            "{robot}: {seconds:?}"
        );
    }
    for number in 0..acknowledged {
        assert!(service.try_get(&path(number)).is_some(), "{number} is lost");
    }
    assert_eq!(service.metric("fleetcal_store_lost_total"), 0);
}

/// Returns the seconds since midnight of `2026-01-01T12:34:56Z`.
fn second(time: &str) -> i64 {
    let (_, clock) = time.split_once('T').unwrap();
    let mut parts = clock.split(|letter: char| !letter.is_ascii_digit());
    let mut part = || parts.next().unwrap().parse::<i64>().unwrap();
    (part() * 60 + part()) * 60 + part()
}
