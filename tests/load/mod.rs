//! Load of a fleet: 50 robots at 100 Hz and 10 Hz × 1024 beams on one machine.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test that cannot go on fails, and this one is run for its figures"
)]

use std::path::Path;
use std::time::Duration;

use fleetcal_proto::RobotId;
use fleetcal_robot::replay::{Rate, ReplayOptions, ReplaySummary, replay};
use fleetcal_tests::recording;
use fleetcal_tests::service::{Service, now};
use serde_json::json;
use tempfile::TempDir;
use tokio::task::JoinSet;
use zenoh::Config;

/// Robots at once.
const ROBOTS: usize = 50;
/// Seconds that each of them drives, in real time.
const DURATION_S: f64 = 20.0;
/// Hundredths of a second that unknown robots drive.
const UNKNOWN_TICKS: usize = 500;
/// Size of a drive sample, bytes.
const DRIVE_BYTES: usize = 48;
/// Size of a scan of 1,081 beams, bytes.
const SCAN_BYTES: usize = 4_384;

/// Cost of the driving robots for the service.
struct Cost {
    summaries: Vec<ReplaySummary>,
    cpu_s: f64,
    took_s: f64,
}

impl Cost {
    fn messages(&self) -> u64 {
        let summaries = self.summaries.iter();
        summaries
            .map(|summary| summary.drive_samples + summary.scans)
            .sum()
    }

    /// Returns the CPU time of one message.
    fn per_message_us(&self) -> f64 {
        1e6 * self.cpu_s / self.messages() as f64
    }
}

async fn drive(service: &Service, path: &Path, names: &[String]) -> Cost {
    let (cpu_s, began) = (service.cpu_s(), now());
    let mut robots = JoinSet::new();
    for name in names {
        let mut options = ReplayOptions::new(path.to_owned(), vec![service.endpoint()]);
        options.robot = Some(RobotId::parse(name).unwrap());
        options.rate = Rate::Times(1.0);
        robots.spawn(async move { replay(options, |_| {}).await.unwrap() });
    }
    let summaries = robots.join_all().await;
    Cost {
        summaries,
        cpu_s: service.cpu_s() - cpu_s,
        took_s: began.elapsed().as_secs_f64(),
    }
}

fn named(prefix: &str) -> Vec<String> {
    let numbers = 1..=ROBOTS;
    numbers
        .map(|number| format!("{prefix}_{number:02}"))
        .collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn fifty_robots_lose_no_drive_sample() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("robot.mcap");
    recording::simulated(&path, DURATION_S);
    let names = named("robot");
    let known: Vec<&str> = names.iter().map(String::as_str).collect();
    let service = Service::start(&known);
    let cost = drive(&service, &path, &names).await;
    for summary in &cost.summaries {
        let counters = service.accounts_of(summary.robot.as_str());
        assert_eq!(
            counters["dropped_wheel_odometry"], 0,
            "{}: {counters}",
            summary.robot
        );
        assert_eq!(counters["refused"], 0, "{}: {counters}", summary.robot);
        assert_eq!(counters["received"], summary.drive_samples + summary.scans);
    }
    let cores = std::thread::available_parallelism().unwrap().get();
    println!(
        "{ROBOTS} robots, {} messages in {:.1} s: {:.2} ms of CPU time per robot-second, {:.1} µs per \
         message, {:.2} cores in all, {:.0} % of the machine's {cores}, {} MiB",
        cost.messages(),
        cost.took_s,
        1e3 * cost.cpu_s / (ROBOTS as f64 * DURATION_S),
        cost.per_message_us(),
        cost.cpu_s / cost.took_s,
        100.0 * cost.cpu_s / cost.took_s / cores as f64,
        service.memory_bytes() >> 20,
    );
    take_in_alone(&service).await;
}

/// Sends messages of a robot without a vehicle: the service receives them and does no more with
/// them.
async fn take_in_alone(service: &Service) {
    let connect = json!({ "mode": "client", "connect": { "endpoints": [service.endpoint()] } });
    let config = Config::from_json5(&connect.to_string()).unwrap();
    let session = zenoh::open(config).await.unwrap();
    let mut drives = Vec::new();
    let mut scans = Vec::new();
    for name in named("unknown") {
        let publisher = |stream| session.declare_publisher(format!("fleet/{name}/{stream}"));
        drives.push(publisher("wheel_odometry").await.unwrap());
        scans.push(publisher("scan").await.unwrap());
    }
    let (cpu_s, began) = (service.cpu_s(), now());
    let mut ticks = tokio::time::interval(Duration::from_millis(10));
    let mut messages = 0;
    for tick in 0..UNKNOWN_TICKS {
        ticks.tick().await;
        for drive in &drives {
            drive.put(vec![0_u8; DRIVE_BYTES]).await.unwrap();
        }
        messages += drives.len();
        if tick % 10 == 0 {
            for scan in &scans {
                scan.put(vec![0_u8; SCAN_BYTES]).await.unwrap();
            }
            messages += scans.len();
        }
    }
    let (cpu_s, took_s) = (service.cpu_s() - cpu_s, began.elapsed().as_secs_f64());
    let received = service.robot("unknown_01")["counters"]["received"].clone();
    assert!(received.as_u64().unwrap() > 0, "{received}");
    println!(
        "taken in alone, of {ROBOTS} robots without a vehicle: {messages} messages in {took_s:.1} s, \
         {:.1} µs of CPU time per message",
        1e6 * cpu_s / messages as f64,
    );
}
