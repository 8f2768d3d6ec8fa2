//! Rounds that are kept: each one that has passed stands in a file with its figures, so that a
//! campaign goes on where it stopped.

use std::collections::BTreeMap;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use fleetcal_contract::own_server::number;
use fleetcal_tests::binary;

/// Figures of the rounds of a kind, by seed.
#[derive(Debug)]
pub struct Progress {
    file: Option<PathBuf>,
    /// Seeds that are to be run, or were.
    wanted: u64,
    /// What each round that has passed has found.
    pub rounds: BTreeMap<u64, Vec<f64>>,
}

impl Progress {
    /// Of a kind, of which `CLUSTER_ROUNDS_{KIND}` rounds are asked for, else `rounds`.
    /// `CLUSTER_PROGRESS` is the folder of the files, else every round is run.
    pub fn of(kind: &str, rounds: usize) -> Self {
        let wanted = number(&format!("CLUSTER_ROUNDS_{}", kind.to_uppercase()), rounds) as u64;
        let file = std::env::var_os("CLUSTER_PROGRESS").map(|folder| {
            fs::create_dir_all(&folder).unwrap();
            PathBuf::from(folder).join(format!("{kind}.rounds"))
        });
        let rounds = file.as_deref().map(read).unwrap_or_default();
        Self {
            file,
            wanted,
            rounds,
        }
    }

    /// Seeds that have not passed yet.
    pub fn open(&self) -> Vec<u64> {
        let wanted = 1..=self.wanted;
        wanted
            .filter(|seed| !self.rounds.contains_key(seed))
            .collect()
    }

    /// Notes a round that has passed: the seed, its figures, and what it was run with.
    pub fn passed(&mut self, seed: u64, figures: Vec<f64>) {
        let told: Vec<_> = figures.iter().map(|one| format!("{one:.4}")).collect();
        if let Some(file) = &self.file {
            let opened = OpenOptions::new().create(true).append(true).open(file);
            writeln!(opened.unwrap(), "{seed} {} # {}", told.join(" "), program()).unwrap();
        }
        self.rounds.insert(seed, figures);
    }

    /// The figure at a place in every round.
    pub fn figures(&self, at: usize) -> Vec<f64> {
        let rounds = self.rounds.values();
        rounds
            .filter_map(|figures| figures.get(at).copied())
            .collect()
    }

    /// The sum of the figure at a place, a count.
    pub fn count(&self, at: usize) -> u64 {
        self.figures(at).iter().sum::<f64>().round() as u64
    }

    /// Rounds that have passed.
    pub fn len(&self) -> u64 {
        self.rounds.len() as u64
    }

    /// The seeds, and what the rounds were run with now.
    pub fn told(&self, server: &str) -> String {
        let seeds = self.rounds.keys();
        let (first, last) = (seeds.clone().next(), seeds.clone().next_back());
        format!(
            "seeds {} to {}; {}; PostgreSQL {server}; Zenoh {}",
            first.copied().unwrap_or_default(),
            last.copied().unwrap_or_default(),
            program(),
            zenoh(),
        )
    }
}

fn read(file: &Path) -> BTreeMap<u64, Vec<f64>> {
    let text = fs::read_to_string(file).unwrap_or_default();
    let round = |line: &str| {
        let line = line.split('#').next()?;
        let mut words = line.split_whitespace();
        let seed = words.next()?.parse().ok()?;
        Some((seed, words.map(|word| word.parse().unwrap()).collect()))
    };
    text.lines().filter_map(round).collect()
}

/// What `fleetcal --version` says.
fn program() -> String {
    let said = binary::run(["--version"]);
    String::from_utf8_lossy(&said.stdout).trim().to_owned()
}

/// The version of Zenoh that this is built with.
fn zenoh() -> String {
    let lock = concat!(env!("CARGO_MANIFEST_DIR"), "/../Cargo.lock");
    let lock = fs::read_to_string(lock).unwrap_or_default();
    let mut lines = lock.lines().skip_while(|line| *line != "name = \"zenoh\"");
    let version = lines
        .nth(1)
        .and_then(|line| line.strip_prefix("version = "));
    version.unwrap_or("unknown").trim_matches('"').to_owned()
}
