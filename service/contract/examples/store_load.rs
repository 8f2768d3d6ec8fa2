//! Measures a database under a fleet's telemetry: 1,000 calibrated robots' seconds for a while, with a
//! decision every 100 ms beside it, on SQLite and, where `FLEETCAL_TEST_POSTGRES` names a server of
//! this machine, on PostgreSQL in the same run; there once more for a minute while robots learn.
//!
//! `cargo run --release --example store_load -- [ROBOTS] [SECONDS]`
#![expect(
    clippy::print_stdout,
    clippy::unwrap_used,
    clippy::disallowed_methods,
    reason = "it measures, and prints what it measured"
)]

use std::time::{Duration, Instant};

use fleetcal_clock::SystemClock;
use fleetcal_contract::{KeepRobot, NS, TestDatabase, config, estimate, event, server};
use fleetcal_model::{CalibrationCovariance, ParameterStatus, RobotTime, WallTime};
use fleetcal_proto::estimate::EstimateDocument;
use fleetcal_store::Store;

/// A checkpoint's size, bytes: 5.9 to 7.8 kB were seen (`service/fleet/src/tests/checkpoints.rs`).
const CHECKPOINT_BYTES: usize = 8_000;
/// Longest time for which robots learn here, s.
const LEARNING_S: usize = 60;

/// Activity of all robots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Robots {
    Learning,
    Calibrated,
}

impl Robots {
    /// Returns the time between two checkpoints of a robot, s.
    const fn checkpoint_every_s(self) -> usize {
        match self {
            Self::Learning => 10,
            Self::Calibrated => 60,
        }
    }

    const fn status(self) -> ParameterStatus {
        match self {
            Self::Learning => ParameterStatus::Learning,
            Self::Calibrated => ParameterStatus::Converged,
        }
    }
}

#[tokio::main(flavor = "multi_thread", worker_threads = 2)]
async fn main() {
    let mut arguments = std::env::args().skip(1);
    let mut number = |usual: usize| arguments.next().map_or(usual, |text| text.parse().unwrap());
    let (robots, seconds) = (number(1_000), number(600));
    println!("{robots} robots for {seconds} s, a decision every 100 ms beside them");
    println!("{:<20}  {}", "database", Cost::HEADING);
    let learning = seconds.min(LEARNING_S);
    if let Some(server) = server() {
        let postgres = TestDatabase::on(&server).await;
        let cost = measure(&postgres, robots, seconds, Robots::Calibrated).await;
        println!("{:<20}  {cost}", "PostgreSQL");
        let postgres = TestDatabase::on(&server).await;
        let cost = measure(&postgres, robots, learning, Robots::Learning).await;
        println!("{:<20}  {cost}", "PostgreSQL, learning");
    }
    let sqlite = TestDatabase::in_sqlite();
    let cost = measure(&sqlite, robots, seconds, Robots::Calibrated).await;
    println!("{:<20}  {cost}", "SQLite");
}

/// Measured cost.
struct Cost {
    /// CPU of this process, cores.
    own: f64,
    /// CPU of PostgreSQL's processes, cores.
    server: f64,
    /// Write-ahead log, MB/s; for SQLite the writes of its process.
    log_mb_s: f64,
    p50: Duration,
    p99: Duration,
    rows: u64,
    lost: u64,
}

impl Cost {
    const HEADING: &str =
        "own CPU  server CPU    log MB/s  decision p50      p99    seconds kept   lost";
}

impl std::fmt::Display for Cost {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let milliseconds = |time: Duration| time.as_secs_f64() * 1e3;
        write!(
            f,
            "{:>7.3}  {:>10.3}  {:>10.3}  {:>9.1} ms  {:>4.1} ms  {:>12}  {:>5}",
            self.own,
            self.server,
            self.log_mb_s,
            milliseconds(self.p50),
            milliseconds(self.p99),
            self.rows,
            self.lost
        )
    }
}

async fn measure(database: &TestDatabase, robots: usize, seconds: usize, are: Robots) -> Cost {
    let clock = std::sync::Arc::new(SystemClock::start());
    let store = database.open(clock).await;
    let names: Vec<String> = (0..robots)
        .map(|robot| format!("robot_{robot:04}"))
        .collect();
    // The first second makes the robots' rows.
    second(&store, &names, 0, are);
    store.flush().await.unwrap();
    let before = Spent::now(database).await;
    let began = Instant::now();
    let deciding = tokio::spawn(decide(store.clone(), began, seconds));
    let mut tick = tokio::time::interval(Duration::from_secs(1));
    for number in 1..=seconds {
        tick.tick().await;
        second(&store, &names, number, are);
    }
    let mut latencies = deciding.await.unwrap();
    store.flush().await.unwrap();
    let took_s = began.elapsed().as_secs_f64();
    let spent = Spent::now(database).await;
    latencies.sort_unstable();
    let counters = store.counters();
    store.close().await.unwrap();
    Cost {
        own: (spent.own_s - before.own_s) / took_s,
        server: (spent.server_s - before.server_s) / took_s,
        log_mb_s: (spent.log_bytes - before.log_bytes) / took_s / 1e6,
        p50: latencies[latencies.len() / 2],
        p99: latencies[latencies.len() * 99 / 100],
        rows: counters.history_rows,
        lost: counters.lost + counters.refused,
    }
}

/// Writes one second of the whole fleet, with the checkpoints that are due in it.
fn second(store: &Store, names: &[String], number: usize, are: Robots) {
    let now = store.now();
    let t_s = now.whole_s();
    for (index, name) in names.iter().enumerate() {
        let estimate = moved(name, t_s, index * 31 + number * 17, are);
        store.record_history(&estimate, WallTime(t_s * NS));
        if (index + number).is_multiple_of(are.checkpoint_every_s()) {
            let robot = fleetcal_contract::robot(name);
            store.save_checkpoint(&robot, RobotTime(t_s * NS), checkpoint(index + number));
        }
    }
}

/// Makes an estimate in which every number differs from the previous one in all of its digits.
fn moved(name: &str, t_s: i64, number: usize, are: Robots) -> EstimateDocument {
    let step = |index: usize| 1e-3 * ((number + 7 * index) % 997) as f64 / 3.0;
    let mut estimate = estimate(name, t_s, step(0), 0.3 + step(1));
    let p = &mut estimate.parameters;
    let learnt = [
        &mut p.steering_offset,
        &mut p.lidar_x,
        &mut p.lidar_y,
        &mut p.lidar_yaw,
        &mut p.speed_scale,
        &mut p.time_offset,
    ];
    for (index, parameter) in learnt.into_iter().enumerate() {
        parameter.value += step(index + 2);
        parameter.sigma += step(index + 8);
        parameter.status = are.status();
    }
    estimate.time_s = number as f64 / 7.0;
    estimate.distance_m = number as f64 / 11.0;
    estimate.consistency.nis_mean = 3.0 + step(15);
    estimate.covariance = Some(CalibrationCovariance::from_fn(|row, column| {
        1e-5 * step(4 * row.index() + column.index())
    }));
    estimate
}

/// Makes a decision every 100 ms; returns the latency of each.
async fn decide(store: Store, began: Instant, seconds: usize) -> Vec<Duration> {
    let mut latencies = Vec::new();
    let mut tick = tokio::time::interval(Duration::from_millis(100));
    while began.elapsed() < Duration::from_secs(seconds as u64) {
        tick.tick().await;
        let asked = Instant::now();
        store
            .transact(KeepRobot(config(1.2), event("load")))
            .await
            .unwrap();
        latencies.push(asked.elapsed());
    }
    latencies
}

/// Resources spent so far.
struct Spent {
    own_s: f64,
    server_s: f64,
    log_bytes: f64,
}

impl Spent {
    async fn now(database: &TestDatabase) -> Self {
        let own_s = cpu_s(&std::fs::read_to_string("/proc/self/stat").unwrap(), false);
        let Some(setup) = database.postgres() else {
            return Self {
                own_s,
                server_s: 0.0,
                log_bytes: written_bytes(),
            };
        };
        let (server, log_bytes) = fleetcal_postgres::spent_for_test(setup).await.unwrap();
        Self {
            own_s,
            server_s: server_cpu_s(server),
            log_bytes,
        }
    }
}

/// Returns the CPU time of a server's process, of its present children, and of those that have
/// ended, s.
fn server_cpu_s(server: u32) -> f64 {
    let mut total_s = 0.0;
    for process in std::fs::read_dir("/proc").unwrap().flatten() {
        let Ok(stat) = std::fs::read_to_string(process.path().join("stat")) else {
            continue;
        };
        let Some((head, rest)) = stat.rsplit_once(") ") else {
            continue;
        };
        if head.starts_with(&format!("{server} (")) {
            total_s += cpu_s(&stat, true);
        } else if rest.split(' ').nth(1) == Some(&server.to_string()) {
            total_s += cpu_s(&stat, false);
        }
    }
    total_s
}

/// Returns the CPU time in a line of `/proc/PID/stat`, with or without that of ended children, s.
fn cpu_s(stat: &str, with_children: bool) -> f64 {
    const TICKS_PER_S: f64 = 100.0;
    let (_, rest) = stat.rsplit_once(") ").unwrap();
    let ticks = rest
        .split(' ')
        .skip(11)
        .take(if with_children { 4 } else { 2 });
    ticks
        .map(|text| text.trim().parse::<f64>().unwrap())
        .sum::<f64>()
        / TICKS_PER_S
}

/// Returns the number of bytes that this process has written to the disk.
fn written_bytes() -> f64 {
    let io = std::fs::read_to_string("/proc/self/io").unwrap();
    let line = io
        .lines()
        .find_map(|line| line.strip_prefix("write_bytes: "));
    line.unwrap().parse().unwrap()
}

/// Makes an incompressible state of the usual size.
fn checkpoint(number: usize) -> Vec<u8> {
    let mut state = Vec::with_capacity(CHECKPOINT_BYTES + 8);
    let mut bits = number as u64 | 1;
    while state.len() < CHECKPOINT_BYTES {
        bits ^= bits << 13;
        bits ^= bits >> 7;
        bits ^= bits << 17;
        state.extend(bits.to_le_bytes());
    }
    state
}
