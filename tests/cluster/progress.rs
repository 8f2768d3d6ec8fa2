//! Rounds that are kept: each one that has passed stands in a file with its figures, so that a
//! campaign goes on where it stopped, and each that was begun, so that those that failed are counted.

use std::collections::BTreeMap;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::PathBuf;
use std::process::Command;

use fleetcal_contract::own_server::number;
use fleetcal_tests::binary;

use crate::figures::told;

/// Mark in the file instead of figures when a round begins.
const BEGUN: &str = "begun";

/// Figures of the rounds of a kind, by seed.
#[derive(Debug)]
pub struct Progress {
    file: Option<PathBuf>,
    /// Number of seeds to run.
    wanted: u64,
    /// Figures of each round that has passed.
    pub rounds: BTreeMap<u64, Vec<f64>>,
    /// Rounds of former runs that failed or were broken off.
    pub failed: u64,
}

impl Progress {
    /// Makes the progress of a kind, with `CLUSTER_ROUNDS_{KIND}` rounds, else `rounds`.
    /// `CLUSTER_PROGRESS` is the folder of the files; without it every round is run.
    pub fn of(kind: &str, rounds: usize) -> Self {
        let wanted = number(&format!("CLUSTER_ROUNDS_{}", kind.to_uppercase()), rounds) as u64;
        let file = std::env::var_os("CLUSTER_PROGRESS").map(|folder| {
            fs::create_dir_all(&folder).unwrap();
            PathBuf::from(folder).join(format!("{kind}.rounds"))
        });
        let text = file.as_deref().map(fs::read_to_string);
        let (rounds, failed) = read(&text.and_then(Result::ok).unwrap_or_default());
        Self {
            file,
            wanted,
            rounds,
            failed,
        }
    }

    /// Returns the seeds that have not passed yet.
    pub fn open(&self) -> Vec<u64> {
        let wanted = 1..=self.wanted;
        wanted
            .filter(|seed| !self.rounds.contains_key(seed))
            .collect()
    }

    /// Records that a round begins: unless it passes, it counts as failed from the next run on.
    pub fn begin(&self, seed: u64) {
        self.note(seed, BEGUN);
    }

    /// Records a round that has passed: the seed, its figures, and the program and server it ran
    /// with.
    pub fn passed(&mut self, seed: u64, figures: Vec<f64>) {
        let told: Vec<_> = figures.iter().map(|one| format!("{one:.4}")).collect();
        self.note(seed, &told.join(" "));
        self.rounds.insert(seed, figures);
    }

    fn note(&self, seed: u64, what: &str) {
        if let Some(file) = &self.file {
            let opened = OpenOptions::new().create(true).append(true).open(file);
            writeln!(opened.unwrap(), "{seed} {what} # {}", program()).unwrap();
        }
    }

    /// Formats the number of rounds of former runs that failed for any reason, or were broken off,
    /// of all that were begun.
    pub fn told_failed(&self) -> String {
        told(self.failed, self.len() + self.failed)
    }

    /// Returns the figure at a place in every round.
    pub fn figures(&self, at: usize) -> Vec<f64> {
        let rounds = self.rounds.values();
        rounds
            .filter_map(|figures| figures.get(at).copied())
            .collect()
    }

    /// Returns the sum of the figure at a place, a count.
    pub fn count(&self, at: usize) -> u64 {
        self.figures(at).iter().sum::<f64>().round() as u64
    }

    /// Returns the number of rounds that have passed.
    pub fn len(&self) -> u64 {
        self.rounds.len() as u64
    }

    /// Formats the seeds, and the present program and server.
    pub fn told(&self, server: &str) -> String {
        let seeds = self.rounds.keys();
        let (first, last) = (seeds.clone().next(), seeds.clone().next_back());
        format!(
            "seeds {} to {}; failed or broken off before: {}; {}; PostgreSQL {server}; Zenoh {}",
            first.copied().unwrap_or_default(),
            last.copied().unwrap_or_default(),
            self.failed,
            program(),
            zenoh(),
        )
    }
}

/// Returns the rounds that have passed, and the number of others that were begun.
fn read(text: &str) -> (BTreeMap<u64, Vec<f64>>, u64) {
    let mut rounds = BTreeMap::new();
    let mut open = BTreeMap::<u64, u64>::new();
    for line in text.lines() {
        let mut words = line
            .split('#')
            .next()
            .unwrap_or_default()
            .split_whitespace();
        let Some(seed) = words.next().and_then(|word| word.parse().ok()) else {
            continue;
        };
        let words: Vec<_> = words.collect();
        let begun = open.entry(seed).or_default();
        if words == [BEGUN] {
            *begun += 1;
        } else {
            *begun = begun.saturating_sub(1);
            let figures = words.iter().map(|word| word.parse().unwrap()).collect();
            rounds.insert(seed, figures);
        }
    }
    (rounds, open.values().sum())
}

/// Returns the output of `fleetcal --version`, and the commit that is checked out, with a mark of
/// changes.
fn program() -> String {
    let said = binary::run(["--version"]);
    let version = String::from_utf8_lossy(&said.stdout).trim().to_owned();
    let git = Command::new("git")
        .args(["describe", "--always", "--dirty"])
        .output();
    match git {
        Ok(git) if git.status.success() => {
            let commit = String::from_utf8_lossy(&git.stdout).trim().to_owned();
            format!("{version} of {commit}")
        }
        _ => version,
    }
}

/// Returns the version of Zenoh of this build.
fn zenoh() -> String {
    let lock = concat!(env!("CARGO_MANIFEST_DIR"), "/../Cargo.lock");
    let lock = fs::read_to_string(lock).unwrap_or_default();
    let mut lines = lock.lines().skip_while(|line| *line != "name = \"zenoh\"");
    let version = lines
        .nth(1)
        .and_then(|line| line.strip_prefix("version = "));
    version.unwrap_or("unknown").trim_matches('"').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_round_that_was_begun_and_has_not_passed_counts_as_failed() {
        let text = "1 begun # v\n1 0.5 3 # v\n2 begun # v\n2 begun # v\n2 0.7 4 # v\n3 begun # v\n";
        let (rounds, failed) = read(text);
        assert_eq!(rounds.keys().copied().collect::<Vec<_>>(), [1, 2]);
        assert_eq!((rounds[&2].clone(), failed), (vec![0.7, 4.0], 2));
        // Files of former versions hold no beginnings.
        assert_eq!(read("7 0.5 # v\n").1, 0);
    }
}
