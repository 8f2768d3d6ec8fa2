//! Fifty robots for hours with a flood of each kind in turn: what the process holds does not grow.
//! `make soak`; `SOAK_MINUTES` shortens it.

use std::path::Path;
use std::time::Duration;

use fleetcal_tests::recording;
use fleetcal_tests::service::{Service, wait_for};
use tempfile::TempDir;

use super::flood_kinds::KINDS;
use super::floods::{Crowd, List, ROBOTS, SESSIONS, database_bytes, started};

/// Default duration, min; `SOAK_MINUTES` sets another.
const MINUTES: u64 = 120;
/// Parts of the whole: one without a flood and one with each kind, twice.
const PERIODS: u64 = 2 * (1 + KINDS.len() as u64);
/// Name of the period against which the others' growth of database and log is compared.
const NOTHING: &str = "nothing";
/// Memory limit of the process, bytes.
const MEMORY_MAX_BYTES: u64 = 256 << 20;
const GROWTH_MAX_BYTES_PER_H: f64 = (1 << 20) as f64;
const OTHERS_MAX: usize = 2;
/// Time after which idle threads have ended, 10 s by tokio's default: a count before includes work
/// that has just ended.
const IDLE_THREADS_GONE_AFTER: Duration = Duration::from_secs(12);
/// Number of such waits.
const SETTLES_WITHIN: usize = 5;

/// Resources of the process at the end of a period.
#[derive(Debug, Clone, Copy)]
struct Held {
    memory_bytes: u64,
    files: usize,
    threads: usize,
    database_bytes: u64,
    log_bytes: usize,
}

impl Held {
    fn by(service: &Service) -> Self {
        let count = |what: &str| {
            let folder = format!("/proc/{}/{what}", service.pid());
            std::fs::read_dir(folder).unwrap().count()
        };
        Self {
            memory_bytes: service.memory_bytes(),
            files: count("fd"),
            threads: count("task"),
            database_bytes: database_bytes(service),
            log_bytes: service.logged().len(),
        }
    }
}

impl Held {
    /// Measures it once no more threads end.
    fn when_settled(service: &Service) -> Self {
        let mut held = Self::by(service);
        for _ in 0..SETTLES_WITHIN {
            std::thread::sleep(IDLE_THREADS_GONE_AFTER);
            let before = std::mem::replace(&mut held, Self::by(service));
            if before.threads == held.threads {
                break;
            }
        }
        held
    }
}

/// Returns the median of the slopes between all pairs (Theil and Sen), bytes a period.
fn slope(held: &[Held]) -> f64 {
    let mut slopes = Vec::new();
    for (from, first) in held.iter().enumerate() {
        for (to, second) in held.iter().enumerate().skip(from + 1) {
            let grown = second.memory_bytes as f64 - first.memory_bytes as f64;
            slopes.push(grown / (to - from) as f64);
        }
    }
    slopes.sort_by(f64::total_cmp);
    slopes.get(slopes.len() / 2).copied().unwrap_or_default()
}

/// Runs a period: the robots drive, and for a sixth of it the service is attacked.
fn period(service: &Service, recording: &Path, kind: &str, seconds: u64) {
    let (drive_s, robots) = (seconds.to_string(), ROBOTS.to_string());
    let endpoint = service.endpoint();
    let path = recording.to_str().unwrap();
    let mut fleet = Crowd::start(&["robots", &endpoint, &drive_s, &robots, path, "anonymous"]);
    if kind == NOTHING {
        fleet.hear();
        return;
    }
    let (flood_s, sessions) = ((seconds / 6).max(2).to_string(), SESSIONS.to_string());
    let mut hostile = Crowd::start(&["hostile", &endpoint, &flood_s, &sessions, kind, "anonymous"]);
    hostile.hear();
    drop(hostile);
    fleet.hear();
}

#[test]
#[ignore = "two hours; make soak"]
fn what_the_process_holds_does_not_grow() {
    let asked = std::env::var("SOAK_MINUTES").ok();
    let minutes = asked.map_or(MINUTES, |text| text.parse().unwrap());
    let seconds = minutes * 60 / PERIODS;
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("robot.mcap");
    recording::simulated(&path, seconds as f64);
    let service = started(List::Default, folder.path());
    let (mut held, mut before) = (Vec::new(), Held::by(&service));
    let kinds = std::iter::once(NOTHING).chain(KINDS);
    for kind in kinds.cycle().take(PERIODS as usize) {
        period(&service, &path, kind, seconds);
        wait_for("the end of all sessions", || {
            (service.robot("robot_01")["alive"] != true).then_some(())
        });
        let now = Held::when_settled(&service);
        println!(
            "{kind}: {} MiB, {} files, {} threads, database +{} kB, log +{} kB",
            now.memory_bytes >> 20,
            now.files,
            now.threads,
            now.database_bytes.saturating_sub(before.database_bytes) / 1_000,
            (now.log_bytes - before.log_bytes) / 1_000
        );
        before = now;
        held.push(now);
    }
    // The first half warms up: each kind of flood has been there once.
    let (_, settled) = held.split_at(held.len() / 2);
    let per_hour = slope(settled) * 3_600.0 / seconds as f64;
    println!(
        "{minutes} min: {:.1} MiB/h after the first half",
        per_hour / f64::from(1 << 20)
    );
    let first = settled[0];
    for later in settled {
        assert!(later.memory_bytes <= MEMORY_MAX_BYTES, "{later:?}");
        assert!(
            later.files.abs_diff(first.files) <= OTHERS_MAX,
            "{first:?}, {later:?}"
        );
        assert!(
            later.threads.abs_diff(first.threads) <= OTHERS_MAX,
            "{first:?}, {later:?}"
        );
    }
    // A slope of minutes is no slope of hours.
    assert!(
        minutes < MINUTES || per_hour <= GROWTH_MAX_BYTES_PER_H,
        "{held:?}"
    );
}
