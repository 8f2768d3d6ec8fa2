//! Every N-th write and sync fails, N from 1 until a run meets no fault. Hours; goes on where it
//! stopped: `make hardening-store`.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::Path;

use fleetcal_tests::service::{self, Service};

use crate::durability::injected::{Faults, Robots, SYNC, can_inject, settle};

/// Writes after which a run without a fault ends.
const WRITES: usize = 40;
/// Runs of one service: its database grows, and with it the work of a write.
const RUNS_OF_A_SERVICE: usize = 50;
/// Faults: system call and error.
const FAULTS: [(&str, &str); 4] = [
    ("pwrite64", "EIO"),
    ("pwrite64", "ENOSPC"),
    (SYNC, "EIO"),
    (SYNC, "ENOSPC"),
];

/// Runs of an earlier campaign: a line for each, `call error N failed`.
#[derive(Debug, Default)]
struct Progress {
    runs: Vec<(String, String, usize, usize)>,
}

impl Progress {
    fn read(path: &Path) -> Self {
        let text = fs::read_to_string(path).unwrap_or_default();
        let run = |line: &str| {
            let words: Vec<_> = line.split(' ').collect();
            let [call, error, n, failed] = words.as_slice() else {
                panic!("{}: {line:?} is no run", path.display());
            };
            let number = |word: &str| word.parse().unwrap();
            (
                (*call).to_owned(),
                (*error).to_owned(),
                number(n),
                number(failed),
            )
        };
        Self {
            runs: text.lines().map(run).collect(),
        }
    }

    /// Returns the next N of a fault; `None` after a run that met none.
    fn next(&self, (call, error): (&str, &str)) -> Option<usize> {
        let mut runs = self
            .runs
            .iter()
            .filter(|run| run.0 == call && run.1 == error);
        match runs.next_back() {
            None => Some(1),
            Some((_, _, _, 0)) => None,
            Some((_, _, n, _)) => Some(n + 1),
        }
    }

    fn add(&mut self, path: &Path, (call, error): (&str, &str), n: usize, failed: usize) {
        let mut file = OpenOptions::new()
            .create(true)
            .append(true)
            .open(path)
            .unwrap();
        writeln!(file, "{call} {error} {n} {failed}").unwrap();
        self.runs
            .push((call.to_owned(), error.to_owned(), n, failed));
    }
}

/// Runs one case: the N-th call of each thread fails while robots are registered; returns the
/// number of failures.
fn run(service: &Service, robots: &mut Robots, (call, error): (&str, &str), n: usize) -> usize {
    let faults = Faults::begin(service, call, &format!("error={error}:when={n}"));
    for _ in 0..WRITES {
        robots.register(service);
        if faults.count() > 0 {
            break;
        }
    }
    let failed = faults.end();
    let recovered = robots.recover(service);
    println!("{call} {error} N={n}: {failed} failed, writing works after {recovered:?}");
    failed
}

#[test]
#[ignore = "takes hours; make hardening-store"]
fn every_nth_write_and_sync_fails() {
    if !can_inject() {
        return;
    }
    let path = std::env::var("FAULTS_PROGRESS").unwrap();
    let path = Path::new(&path);
    let mut progress = Progress::read(path);
    let began = service::now();
    let (mut runs, mut acknowledged, mut refused) = (0, 0, 0);
    for fault in FAULTS {
        while progress.next(fault).is_some() {
            let mut service = Service::start(&[]);
            let mut robots = Robots::default();
            for _ in 0..RUNS_OF_A_SERVICE {
                let Some(n) = progress.next(fault) else { break };
                let failed = run(&service, &mut robots, fault, n);
                progress.add(path, fault, n, failed);
                runs += 1;
            }
            settle(&service);
            assert_eq!(service.metric("fleetcal_store_lost_total"), 0);
            service.kill();
            service.restart();
            robots.check(&service);
            acknowledged += robots.acknowledged();
            refused += robots.refused();
        }
    }
    println!(
        "{runs} runs in {:?}, {} in all: {acknowledged} writes acknowledged, 0 lost, {refused} refused",
        began.elapsed(),
        progress.runs.len()
    );
}
