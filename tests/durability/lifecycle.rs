//! The process itself: killed while it makes its database, told to stop under load, stopped for a
//! while, short of file descriptors.

use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use fleetcal_ports::free_address;
use fleetcal_tests::service::{Service, now, wait_for};
use fleetcal_tests::{binary, recording};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use tempfile::TempDir;

use crate::durability::seeds::campaign;

/// Rounds of each in the suite; `HARDENING_N` sets another number.
const ROUNDS: u64 = 3;
/// Time within which a stopped service has ended.
const STOPS_WITHIN: Duration = Duration::from_secs(5);
/// Longest duration of a first start on a busy machine before it is killed, ms.
const FIRST_START_MS: u64 = 400;
/// Robots that drive meanwhile, and the duration, s.
const ROBOTS: usize = 10;
const DRIVE_S: u64 = 20;

/// Driving robots, in a process of their own.
pub struct Fleet {
    child: Child,
    _folder: TempDir,
}

impl Fleet {
    /// Starts `robot_01` and so on, as many as `robots`.
    pub fn drives(service: &Service, robots: usize, seconds: u64) -> Self {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("robot.mcap");
        recording::simulated(&path, seconds as f64);
        let mut child = Command::new(env!("CARGO_BIN_EXE_fleetcal-crowd"))
            .args(["robots", &service.endpoint(), &seconds.to_string()])
            .args([&robots.to_string(), path.to_str().unwrap(), "anonymous"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let mut said = BufReader::new(child.stdout.take().unwrap());
        said.read_line(&mut line).unwrap();
        assert!(line.contains("ready"), "{line}");
        Self {
            child,
            _folder: folder,
        }
    }
}

impl Drop for Fleet {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

fn with_robots() -> Service {
    let names: Vec<String> = (1..=ROBOTS)
        .map(|number| format!("robot_{number:02}"))
        .collect();
    Service::start(&names.iter().map(String::as_str).collect::<Vec<_>>())
}

fn signal(service: &Service, name: &str) {
    let sent = Command::new("kill")
        .args([name, &service.pid().to_string()])
        .status();
    assert!(sent.unwrap().success());
}

pub fn received(service: &Service) -> u64 {
    let counters = service.robot("robot_01")["counters"].clone();
    counters["received"].as_u64().unwrap()
}

/// Checks that after a kill in any migration of a new database, the next start continues.
#[test]
fn a_service_killed_in_its_migrations_starts_again() {
    campaign("migrations", ROUNDS, |seed| {
        let mut random = StdRng::seed_from_u64(seed);
        let folder = TempDir::new().unwrap();
        let data = folder.path().join("data");
        for _ in 0..2 {
            let mut child = Command::new(binary::path())
                .args(["serve", "--http", &free_address().to_string()])
                .args(["--listen", &format!("tcp/{}", free_address()), "--data"])
                .arg(&data)
                .env_remove("ZENOH_CONFIG")
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .unwrap();
            let delay = Duration::from_micros(random.random_range(0..FIRST_START_MS * 1_000));
            std::thread::sleep(delay);
            child.kill().unwrap();
            child.wait().unwrap();
        }
        let service = Service::start_with_data(&data);
        assert_eq!(service.status("/readyz", None), 200, "seed {seed}");
    });
}

#[test]
fn a_service_that_is_told_to_stop_under_load_ends_in_time_and_in_order() {
    let mut service = with_robots();
    let _fleet = Fleet::drives(&service, ROBOTS, DRIVE_S);
    let mut longest = Duration::ZERO;
    campaign("sigterm", ROUNDS, |seed| {
        let mut random = StdRng::seed_from_u64(seed);
        std::thread::sleep(Duration::from_millis(random.random_range(0..1_500)));
        let robot = format!("added_{seed}");
        service.register(&robot, r#"{"model":"bicycle","wheelbase_m":1.2}"#);
        let (status, took) = service.terminate();
        assert!(
            status.success() && took <= STOPS_WITHIN,
            "seed {seed}: {status}, {took:?}"
        );
        longest = longest.max(took);
        service.restart();
        assert_eq!(service.robot(&robot)["id"], robot.as_str(), "seed {seed}");
    });
    println!("the longest stop took {longest:?}");
}

#[test]
fn a_service_that_was_stopped_for_a_while_goes_on_and_tells_what_it_missed() {
    let service = with_robots();
    let asked = std::env::var("HARDENING_STOPPED_S").ok();
    let stopped = Duration::from_secs(asked.map_or(3, |text| text.parse().unwrap()));
    let _fleet = Fleet::drives(&service, ROBOTS, stopped.as_secs() + DRIVE_S);
    wait_for("the first messages", || {
        (received(&service) > 100).then_some(())
    });
    signal(&service, "-STOP");
    std::thread::sleep(stopped);
    signal(&service, "-CONT");
    let (before, went_on) = (received(&service), now());
    wait_for("further messages", || {
        (received(&service) > before).then_some(())
    });
    println!(
        "stopped for {stopped:?}, went on after {:?}; {} messages are missing by their stamps",
        went_on.elapsed(),
        service.metric("fleetcal_messages_dropped_total{reason=\"missing\"}"),
    );
    assert_eq!(service.status("/readyz", None), 200);
}

#[test]
fn a_service_with_64_file_descriptors_goes_on_when_some_are_free_again() {
    let service = with_robots();
    let _fleet = Fleet::drives(&service, ROBOTS, DRIVE_S);
    let limit = Command::new("prlimit")
        .args(["--pid", &service.pid().to_string(), "--nofile=64:64"])
        .status();
    assert!(limit.unwrap().success());
    let http = service.http();
    let taken: Vec<TcpStream> = (0..64)
        .map_while(|_| TcpStream::connect(http).ok())
        .collect();
    std::thread::sleep(Duration::from_secs(2));
    drop(taken);
    wait_for("readiness", || {
        let answer = fleetcal_tests::http::get(http, "/readyz", None)?;
        (answer.status == 200).then_some(())
    });
    let before = received(&service);
    wait_for("further messages", || {
        (received(&service) > before).then_some(())
    });
    service.register("robot_77", r#"{"model":"bicycle","wheelbase_m":1.2}"#);
}
