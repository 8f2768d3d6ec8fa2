//! Load of a fleet at 100 Hz and 10 Hz × 1024 beams on one machine: 50 robots, or as many as the
//! environment says.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test that cannot go on fails, and this one is run for its figures"
)]

mod figures;
mod fleet;
mod held;

use std::collections::{BTreeMap, BTreeSet};
use std::env;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use fleetcal_tests::rewritten::together;
use fleetcal_tests::service::{Service, now};
use fleetcal_tests::{memory, recording};
use serde_json::json;
use tempfile::TempDir;
use zenoh::Config;

use fleet::{Course, Sent, Sessions};
use held::Held;

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

/// Load of a run, by the environment.
struct Load {
    /// Robots at once: `LOAD_ROBOTS`.
    robots: usize,
    /// Seconds that each of them drives, in real time: `LOAD_SECONDS`.
    duration_s: f64,
    /// Sessions of the robots: `LOAD_SESSIONS`, `one` or `each`.
    sessions: Sessions,
    /// True if up to 100 ms of drive samples are in one message: `LOAD_SAMPLES`, `single` or
    /// `several`.
    several: bool,
    /// Part of the needed CPU time that the service has: `LOAD_HELD`.
    held: Option<f64>,
}

impl Load {
    fn of_environment() -> Self {
        let given = |name: &str| env::var(name).ok().filter(|text| !text.is_empty());
        let number = |name: &str| given(name).map(|text| text.parse::<f64>().unwrap());
        let one_of = |name: &str, words: [&str; 2]| {
            let word = given(name).unwrap_or_else(|| words[0].to_owned());
            assert!(
                words.contains(&word.as_str()),
                "{name}: got {word}, expected {words:?}"
            );
            word == words[0]
        };
        Self {
            robots: number("LOAD_ROBOTS").map_or(ROBOTS, |robots| robots as usize),
            duration_s: number("LOAD_SECONDS").unwrap_or(DURATION_S),
            sessions: if one_of("LOAD_SESSIONS", ["each", "one"]) {
                Sessions::Each
            } else {
                Sessions::One
            },
            several: one_of("LOAD_SAMPLES", ["several", "single"]),
            held: number("LOAD_HELD"),
        }
    }

    /// Records the course in a folder.
    fn course(&self, folder: &TempDir) -> Arc<Course> {
        let single = folder.path().join("single.mcap");
        recording::simulated(&single, self.duration_s);
        if !self.several {
            return Arc::new(Course::of(&single));
        }
        let several = folder.path().join("several.mcap");
        together(&single, &several);
        Arc::new(Course::of(&several))
    }

    fn in_words(&self) -> String {
        let sessions = match self.sessions {
            Sessions::Each => "a session each",
            Sessions::One => "one session",
        };
        let samples = if self.several {
            "up to 100 ms of drive samples a message"
        } else {
            "a drive sample a message"
        };
        format!("{} robots, {sessions}, {samples}", self.robots)
    }

    fn names(&self, prefix: &str) -> Vec<String> {
        let numbers = 1..=self.robots;
        numbers
            .map(|number| format!("{prefix}_{number:03}"))
            .collect()
    }
}

/// Cost of the driving robots for the service.
struct Cost {
    sent: Vec<Sent>,
    cpu_s: f64,
    by_thread: BTreeMap<String, f64>,
    took_s: f64,
}

impl Cost {
    /// Prints the figures, and adds them to the file `LOAD_FIGURES`.
    fn print(&self, load: &Load, service: &Service) {
        let robot_seconds = load.robots as f64 * load.duration_s;
        let messages: u64 = self.sent.iter().map(|one| one.drives + one.scans).sum();
        let samples: u64 = self.sent.iter().map(|one| one.drive_samples).sum();
        let cores = std::thread::available_parallelism().unwrap().get();
        println!(
            "{}: {messages} messages with {samples} drive samples in {:.1} s, {:.2} of the machine's \
             {cores} cores",
            load.in_words(),
            self.took_s,
            self.cpu_s / self.took_s,
        );
        let per_robot_ms = |used_s: f64| 1e3 * used_s / robot_seconds;
        let mut figures = vec![
            ("CPU time", per_robot_ms(self.cpu_s), "ms per robot-second"),
            ("a message", 1e6 * self.cpu_s / messages as f64, "µs"),
        ];
        let in_scans = service.metric_sum("fleetcal_estimator_scan_duration_seconds_sum");
        let unit = "ms per robot-second";
        figures.push(("estimators, for scans", per_robot_ms(in_scans), unit));
        for (thread, used_s) in &self.by_thread {
            figures.push((thread, per_robot_ms(*used_s), unit));
        }
        let latency = |share| service.metric_quantile("fleetcal_scan_latency_seconds", share);
        for (name, share) in [("half of the scans within", 0.5), ("99 % within", 0.99)] {
            figures.extend(latency(share).map(|latency_s| (name, 1e3 * latency_s, "ms")));
        }
        let memory = memory::of(service.pid());
        let mib = |bytes: u64| (bytes >> 10) as f64 / 1024.0;
        figures.push(("memory", mib(memory.held_bytes), "MiB"));
        figures.push(("most memory", mib(memory.most_bytes), "MiB"));
        figures.retain(|(_, value, _)| *value >= 0.01);
        for (name, value, unit) in &figures {
            println!("  {name}: {value:.2} {unit}");
        }
        if let Some(file) = env::var_os("LOAD_FIGURES").filter(|file| !file.is_empty()) {
            figures::add(Path::new(&file), &load.in_words(), load.robots, &figures);
        }
    }
}

async fn drive(service: &Service, load: &Load, course: &Arc<Course>, names: &[String]) -> Cost {
    let (cpu_s, by_thread, began) = (service.cpu_s(), service.cpu_s_by_thread(), now());
    let sent = course.drive(service, names, load.sessions).await;
    let mut after = service.cpu_s_by_thread();
    for (thread, used_s) in &mut after {
        *used_s -= by_thread.get(thread).unwrap_or(&0.0);
    }
    Cost {
        sent,
        cpu_s: service.cpu_s() - cpu_s,
        by_thread: after,
        took_s: began.elapsed().as_secs_f64(),
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn robots_lose_no_drive_sample() {
    let load = Load::of_environment();
    let folder = TempDir::new().unwrap();
    let course = load.course(&folder);
    let names = load.names("robot");
    let known: Vec<&str> = names.iter().map(String::as_str).collect();
    let service = Service::start(&known);
    if let Some(part) = load.held {
        held_to(part, &service, &load, &course, &names).await;
        return;
    }
    let cost = drive(&service, &load, &course, &names).await;
    for (name, sent) in names.iter().zip(&cost.sent) {
        let counters = service.accounts_of(name);
        assert_eq!(counters["dropped_wheel_odometry"], 0, "{name}: {counters}");
        assert_eq!(counters["refused"], 0, "{name}: {counters}");
        assert_eq!(counters["received"], sent.drives + sent.scans);
        // A former version, to compare with, counts messages alone.
        if let Some(counted) = counters.get("drive_samples") {
            assert_eq!(*counted, sent.drive_samples);
        }
    }
    cost.print(&load, &service);
    take_in_alone(&service, &load).await;
}

/// Drives with all the CPU time that is needed, then with part of it, then with all again. A status
/// that is known stays known, and five seconds after the load no scan is dropped any more.
async fn held_to(
    part: f64,
    service: &Service,
    load: &Load,
    course: &Arc<Course>,
    names: &[String],
) {
    let Some(held) = Held::new(service) else {
        println!("skipped: LOAD_HELD needs control groups of CPU time, version 1, and root");
        return;
    };
    let third = Duration::from_secs_f64(load.duration_s / 3.0);
    let watch = async {
        let used_s = service.cpu_s();
        tokio::time::sleep(third).await;
        let cores = (service.cpu_s() - used_s) / third.as_secs_f64();
        let known_before = known(service, names);
        held.limit(Some(part * cores));
        tokio::time::sleep(third).await;
        let dropped = total(service, names, "dropped_scans");
        let (received, known_held) = (total(service, names, "received"), known(service, names));
        held.limit(None);
        tokio::time::sleep(Duration::from_secs(5)).await;
        let dropped_then = total(service, names, "dropped_scans");
        println!(
            "held to {:.2} of {cores:.2} cores: {received:.0} messages received, {dropped:.0} scans \
             dropped; steering offsets known of {} robots before and {} at the end of it",
            part * cores,
            known_before.len(),
            known_held.len(),
        );
        let lost: Vec<_> = known_before.difference(&known_held).collect();
        assert!(lost.is_empty(), "lost: {lost:?}");
        dropped_then
    };
    let (cost, dropped_then) = tokio::join!(drive(service, load, course, names), watch);
    assert!(total(service, names, "dropped_wheel_odometry") < 0.5);
    let dropped_later = total(service, names, "dropped_scans") - dropped_then;
    assert!(
        dropped_later < 0.5,
        "{dropped_later} scans are dropped 5 s after the load"
    );
    cost.print(load, service);
}

/// Robots whose steering offset is known.
fn known(service: &Service, names: &[String]) -> BTreeSet<String> {
    let is_known = |name: &&String| {
        let estimate = &service.robot(name)["estimate"];
        estimate["parameters"]["steering_offset"]["status"] == "converged"
    };
    names.iter().filter(is_known).cloned().collect()
}

fn total(service: &Service, names: &[String], counter: &str) -> f64 {
    let of_robot = |name: &String| service.robot(name)["counters"][counter].as_f64();
    names.iter().filter_map(of_robot).sum()
}

/// Sends messages of a robot without a vehicle: the service receives them and does no more with
/// them.
async fn take_in_alone(service: &Service, load: &Load) {
    let connect = json!({ "mode": "client", "connect": { "endpoints": [service.endpoint()] } });
    let config = Config::from_json5(&connect.to_string()).unwrap();
    let session = zenoh::open(config).await.unwrap();
    let mut drives = Vec::new();
    let mut scans = Vec::new();
    for name in load.names("unknown") {
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
    let received = service.robot("unknown_001")["counters"]["received"].clone();
    assert!(received.as_u64().unwrap() > 0, "{received}");
    println!(
        "taken in alone, of {} robots without a vehicle: {messages} messages in {took_s:.1} s, \
         {:.1} µs of CPU time per message",
        load.robots,
        1e6 * cpu_s / messages as f64,
    );
}
