//! Hostile sessions beside a fleet: its robots lose no sample.
//!
//! Robots and hostile sessions are processes of their own. The short form is part of the suite;
//! `make hardening-zenoh` repeats each flood for a minute, against both access lists.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Duration;

use fleetcal_contract::own_server::psql;
use fleetcal_ports::free_address;
use fleetcal_tests::service::{Service, now, wait_for};
use fleetcal_tests::{database, recording};
use serde_json::{Value, json};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection};
use tempfile::TempDir;

use super::flood_kinds::KINDS;
use super::lists::{generated, password, passwords};
use super::robot;

/// Driving robots, besides one whose name is attacked.
pub const ROBOTS: usize = 49;
/// Hostile sessions.
pub const SESSIONS: usize = 8;
/// Default duration of a flood, s.
const FLOOD_S: u64 = 8;
/// Time that the robots drive before and after it, s.
const MARGIN_S: u64 = 2;
/// Longest stall on a machine with nothing else to do, beyond that of an undisturbed fleet.
const STALLED_MAX: Duration = Duration::from_secs(1);
const GROWN_MAX_BYTES: u64 = 32 << 20;
/// Silent connections to the Zenoh port.
const SILENT: usize = 1_500;
/// Time within which a robot then has to connect.
const CONNECTS_WITHIN: Duration = Duration::from_secs(5);
/// Time after the robots' end from which missing messages never come.
const NOTHING_COMES: Duration = Duration::from_secs(5);
/// Pause between two checks of a robot.
const LOOK_EVERY: Duration = Duration::from_millis(100);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum List {
    /// The service's own list: anybody connects, and may be any robot.
    Default,
    /// The generated list: each session is a robot with its password.
    Generated,
}

/// Returns the duration of a flood, s.
pub fn seconds() -> u64 {
    let asked = std::env::var("FLEETCAL_ZENOH_FLOOD_S").ok();
    asked.map_or(FLOOD_S, |text| text.parse().unwrap())
}

/// Returns the kinds of a campaign, by the environment: each, and all at once.
pub fn kinds() -> String {
    let asked = std::env::var("FLEETCAL_ZENOH_FLOODS").ok();
    asked.unwrap_or_else(|| format!("{} all", KINDS.join(" ")))
}

/// Returns the names of all robots.
pub fn names() -> Vec<String> {
    (1..=ROBOTS + 1)
        .map(|number| format!("robot_{number:02}"))
        .collect()
}

/// Writes their sections of `fleetcal.toml`.
pub fn sections() -> String {
    let entry = |id: &String| {
        format!("[[robot]]\nid = \"{id}\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n\n")
    };
    names().iter().map(entry).collect()
}

pub fn started(list: List, folder: &Path) -> Service {
    let config = sections();
    if list == List::Default {
        return Service::start_with(&config);
    }
    let zenoh = free_address();
    let names = names();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let file = passwords(folder, &names);
    let listen = format!("tcp/{zenoh}");
    let robots = names.iter().flat_map(|name| ["--robot", name]);
    let rest = ["--identity", "user", "--passwords", &file, "-l", &listen];
    let flags: Vec<&str> = robots.chain(rest).collect();
    let router = generated(folder, &flags);
    Service::start_on(zenoh, &config, &["-c", &router])
}

/// Process of robots or of hostile sessions, ended with its test.
pub struct Crowd {
    child: Child,
    said: BufReader<ChildStdout>,
}

impl Crowd {
    pub fn start(words: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_fleetcal-crowd"))
            .args(words)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let said = BufReader::new(child.stdout.take().unwrap());
        let mut crowd = Self { child, said };
        let ready = crowd.hear();
        assert!(
            ready["ready"].as_u64().is_some_and(|ready| ready > 0),
            "{ready}"
        );
        crowd
    }

    /// Reads the next line.
    pub fn hear(&mut self) -> Value {
        let mut line = String::new();
        self.said.read_line(&mut line).unwrap();
        serde_json::from_str(&line).unwrap()
    }
}

impl Drop for Crowd {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// Effects of a flood on the others.
#[derive(Debug, Default)]
pub struct Figures {
    pub sent: u64,
    pub lost: u64,
    pub dropped_wheel_odometry: u64,
    pub dropped_scans: u64,
    /// Longest time without a message of a robot that sends every 10 ms.
    pub stalled: Duration,
    pub grown_bytes: u64,
    pub database_bytes: u64,
    pub log_bytes: u64,
    pub done: u64,
    /// Samples that were sent, and not received yet when all robots had ended.
    pub late: u64,
}

impl Figures {
    /// Adds the samples of one more robot.
    pub fn add(&mut self, robot: &Self) {
        self.sent += robot.sent;
        self.lost += robot.lost;
        self.late += robot.late;
        self.dropped_wheel_odometry += robot.dropped_wheel_odometry;
        self.dropped_scans += robot.dropped_scans;
    }
}

/// Returns the size of a service's database, including its write-ahead log's own content so far,
/// bytes. The log's file itself never shrinks.
pub fn database_bytes(service: &Service) -> u64 {
    if let Some((_, url)) = database::variable(&service.data()) {
        let bytes = psql(
            &url.parse().unwrap(),
            "SELECT pg_database_size(current_database())",
        );
        return bytes.trim().parse().unwrap();
    }
    let options = SqliteConnectOptions::new().filename(service.data().join("fleetcal.db"));
    let runtime = tokio::runtime::Builder::new_current_thread().build();
    runtime.unwrap().block_on(async {
        let mut database = options.read_only(true).connect().await.unwrap();
        let bytes = "SELECT page_count * page_size FROM pragma_page_count(), pragma_page_size()";
        let bytes: i64 = sqlx::query_scalar(bytes)
            .fetch_one(&mut database)
            .await
            .unwrap();
        database.close().await.unwrap();
        bytes.unsigned_abs()
    })
}

/// A robot that has ended.
pub struct Ended<'a> {
    /// Service that estimates it.
    pub service: &'a Service,
    pub id: &'a str,
    /// Its sent messages, by stream.
    pub of_robot: &'a Value,
}

impl Ended<'_> {
    fn sent(&self) -> u64 {
        let count = |stream: &str| self.of_robot[stream].as_u64().unwrap_or_default();
        count("wheel_odometry") + count("scan")
    }
}

/// Counts the samples of robots that have ended, robot by robot, once no more of them come: while a
/// service undeclares the keys of hostile sessions, some are still in its sockets.
pub fn received_at_last(ended: &[Ended<'_>]) -> Vec<Figures> {
    let received = |counters: &Value| counters["received"].as_u64().unwrap();
    let first = ended.iter().map(|one| one.service.accounts_of(one.id));
    let first: Vec<Value> = first.collect();
    let mut last = first.clone();
    let mut last_came = now();
    loop {
        let mut is_all = true;
        for (one, counters) in ended.iter().zip(&mut last) {
            if received(counters) >= one.sent() {
                continue;
            }
            is_all = false;
            let next = one.service.accounts_of(one.id);
            if received(&next) > received(counters) {
                last_came = now();
            }
            *counters = next;
        }
        if is_all || last_came.elapsed() >= NOTHING_COMES {
            break;
        }
        std::thread::sleep(LOOK_EVERY);
    }
    let counters = first.iter().zip(&last);
    let figures = ended.iter().zip(counters).map(|(one, (first, last))| {
        let counted = |name: &str| last[name].as_u64().unwrap();
        Figures {
            sent: one.sent(),
            lost: one.sent().saturating_sub(received(last)),
            late: received(last).saturating_sub(received(first)),
            dropped_wheel_odometry: counted("dropped_wheel_odometry"),
            dropped_scans: counted("dropped_scans"),
            ..Figures::default()
        }
    });
    figures.collect()
}

/// Drives robots while the service is attacked by `kind`; without a kind, it is not attacked.
pub fn flooded(list: List, kind: Option<&str>, seconds: u64) -> Figures {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("robot.mcap");
    let drive_s = seconds + 2 * MARGIN_S;
    recording::simulated(&path, drive_s as f64);
    let service = started(list, folder.path());
    let (memory, database, log) = (
        service.memory_bytes(),
        database_bytes(&service),
        service.logged().len(),
    );
    let identity = match list {
        List::Default => "anonymous",
        List::Generated => "passwords",
    };
    let (endpoint, drive_s, robots) = (service.endpoint(), drive_s.to_string(), ROBOTS.to_string());
    let mut fleet = Crowd::start(&[
        "robots",
        &endpoint,
        &drive_s,
        &robots,
        path.to_str().unwrap(),
        identity,
    ]);
    std::thread::sleep(Duration::from_secs(MARGIN_S));
    let mut figures = Figures::default();
    if let Some(kind) = kind {
        let (seconds, sessions) = (seconds.to_string(), SESSIONS.to_string());
        let mut hostile =
            Crowd::start(&["hostile", &endpoint, &seconds, &sessions, kind, identity]);
        let hears = std::thread::spawn(move || hostile.hear()["done"].as_u64().unwrap());
        figures.stalled = longest_stall(&service, "robot_01", || !hears.is_finished());
        figures.done = hears.join().unwrap();
    }
    let sent = fleet.hear();
    let sent = sent["sent"].as_object().unwrap();
    let ended = sent.iter().map(|(id, of_robot)| Ended {
        service: &service,
        id,
        of_robot,
    });
    for robot in received_at_last(&ended.collect::<Vec<_>>()) {
        figures.add(&robot);
    }
    figures.grown_bytes = service.memory_bytes().saturating_sub(memory);
    figures.database_bytes = database_bytes(&service).saturating_sub(database);
    figures.log_bytes = (service.logged().len() - log) as u64;
    figures
}

/// Returns the longest time without a message of a robot, while `goes_on`. A service that does not
/// answer shows none.
pub fn longest_stall(service: &Service, id: &str, goes_on: impl Fn() -> bool) -> Duration {
    let received = || {
        let robot = service.try_get(&format!("/api/v1/robots/{id}"));
        robot.and_then(|robot| robot["counters"]["received"].as_u64())
    };
    let (mut last, mut since, mut longest) = (received(), now(), Duration::ZERO);
    while goes_on() {
        std::thread::sleep(LOOK_EVERY);
        let next = received();
        longest = longest.max(since.elapsed().saturating_sub(LOOK_EVERY));
        if next.is_some() && next != last {
            (last, since) = (next, now());
        }
    }
    longest
}

fn report(list: List, kind: &str, figures: &Figures) {
    println!(
        "{kind} by {SESSIONS} sessions ({}), {list:?} list, {} s: {} sent, {} lost, {} late, {} drive \
         samples and {} scans dropped, stalled {:.2} s, memory +{} MiB, database +{} kB, log +{} kB",
        figures.done,
        seconds(),
        figures.sent,
        figures.lost,
        figures.late,
        figures.dropped_wheel_odometry,
        figures.dropped_scans,
        figures.stalled.as_secs_f64(),
        figures.grown_bytes >> 20,
        figures.database_bytes / 1_000,
        figures.log_bytes / 1_000,
    );
}

fn measured(list: List, kind: &str) -> Figures {
    let figures = flooded(list, Some(kind), seconds());
    report(list, kind, &figures);
    assert!(figures.done > 100, "that was no flood: {figures:?}");
    figures
}

/// Asserts that the other robots lose almost nothing. A sender on a busy machine drops a sample now
/// and then by itself, so a few in ten thousand are accepted here. With two receiving threads it
/// was every second one.
fn assert_others_go_on(list: List, kind: &str) {
    let figures = measured(list, kind);
    assert!(figures.lost * 2_000 <= figures.sent, "{kind}: {figures:?}");
}

#[test]
fn sessions_that_declare_tokens_take_no_sample_from_others() {
    assert_others_go_on(List::Default, "tokens");
}

#[test]
fn under_a_list_of_names_no_robot_takes_a_sample_from_another() {
    assert_others_go_on(List::Generated, "all");
}

#[test]
#[ignore = "half an hour; make hardening-zenoh"]
fn every_flood_against_either_list() {
    let kinds = kinds();
    let mut missed = Vec::new();
    for list in [List::Default, List::Generated] {
        let control = flooded(list, None, seconds());
        report(list, "nothing", &control);
        for kind in kinds.split_whitespace() {
            let figures = measured(list, kind);
            let grown = figures.grown_bytes.saturating_sub(control.grown_bytes);
            let is_reached = figures.lost == 0
                && figures.dropped_wheel_odometry <= control.dropped_wheel_odometry
                && figures.stalled <= STALLED_MAX
                && grown <= GROWN_MAX_BYTES;
            if !is_reached {
                missed.push(format!(
                    "{list:?} {kind}: {} MiB beyond, {figures:?}",
                    grown >> 20
                ));
            }
        }
    }
    assert!(missed.is_empty(), "{}", missed.join("\n"));
}

#[test]
fn a_robot_connects_beside_silent_connections() {
    let service = Service::start(&["robot_a"]);
    let address: SocketAddr = service
        .endpoint()
        .trim_start_matches("tcp/")
        .parse()
        .unwrap();
    let silent: Vec<TcpStream> = (0..SILENT)
        .map_while(|_| TcpStream::connect(address).ok())
        .collect();
    assert_eq!(silent.len(), SILENT);
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build();
    let began = now();
    let config = robot::client(&service.endpoint(), &json!({}));
    let session = runtime.unwrap().block_on(robot::open(config)).unwrap();
    let took = began.elapsed();
    println!("beside {SILENT} silent connections a robot connects in {took:?}");
    drop(session);
    assert!(took < CONNECTS_WITHIN, "{took:?}");
    drop(silent);
}

#[test]
fn beyond_loopback_nobody_connects_without_authentication_unless_a_flag_says_so() {
    let folder = TempDir::new().unwrap();
    let log = folder.path().join("log");
    let run = |more: &[&str]| {
        let zenoh = format!("tcp/0.0.0.0:{}", free_address().port());
        Command::new(fleetcal_tests::binary::path())
            .args([
                "serve",
                "--http",
                &free_address().to_string(),
                "--listen",
                &zenoh,
                "--data",
            ])
            .arg(folder.path().join("data"))
            .args(more)
            .env_remove("ZENOH_CONFIG")
            .stdout(Stdio::null())
            .stderr(File::create(&log).unwrap())
            .spawn()
            .unwrap()
    };
    let said = || std::fs::read_to_string(&log).unwrap();
    let status = run(&[]).wait().unwrap();
    assert_eq!(status.code(), Some(2), "{}", said());
    let refusal = said();
    assert_eq!(refusal.trim().lines().count(), 1, "{refusal}");
    assert!(
        refusal.contains("acl generate") && refusal.contains("--allow-anonymous"),
        "{refusal}"
    );
    assert!(!folder.path().join("data").exists(), "nothing was begun");
    let mut allowed = run(&["--allow-anonymous"]);
    wait_for("readiness", || {
        assert_eq!(allowed.try_wait().unwrap(), None, "{}", said());
        said().contains("is ready").then_some(())
    });
    allowed.kill().unwrap();
    allowed.wait().unwrap();
}

/// Checks that a client without password is refused, which the whole default rests on.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_router_with_passwords_takes_nobody_without_one() {
    let folder = TempDir::new().unwrap();
    let service = started(List::Generated, folder.path());
    let anonymous = robot::client(&service.endpoint(), &json!({}));
    assert!(robot::open(anonymous).await.is_err());
    let known = robot::with_password(&service.endpoint(), "robot_01", &password("robot_01"));
    assert!(robot::open(known).await.is_ok());
}
