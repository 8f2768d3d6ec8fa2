//! Campaigns that go on where they stopped: each seed that has passed stands in a file.

use std::collections::BTreeSet;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::PathBuf;

/// Runs `round` for the seeds 1 to N that have not passed yet, and prints the number of all that
/// have. `HARDENING_N` is N, else `rounds`; `HARDENING_SEEDS` is the folder of the files; without
/// it every seed is run.
pub fn campaign(name: &str, rounds: u64, mut round: impl FnMut(u64)) {
    let asked = std::env::var("HARDENING_N").ok();
    let rounds = asked.map_or(rounds, |text| text.parse().unwrap());
    let file = std::env::var_os("HARDENING_SEEDS").map(|folder| {
        fs::create_dir_all(&folder).unwrap();
        PathBuf::from(folder).join(format!("{name}.seeds"))
    });
    let text = file.as_ref().and_then(|file| fs::read_to_string(file).ok());
    let text = text.unwrap_or_default();
    let passed: BTreeSet<u64> = text.lines().map(|line| line.parse().unwrap()).collect();
    let mut run = 0;
    for seed in (1..=rounds).filter(|seed| !passed.contains(seed)) {
        println!("{name}: seed {seed}");
        round(seed);
        run += 1;
        if let Some(file) = &file {
            let opened = OpenOptions::new().create(true).append(true).open(file);
            writeln!(opened.unwrap(), "{seed}").unwrap();
        }
    }
    println!(
        "{name}: {run} rounds now, {} in all, 0 failed",
        passed.len() as u64 + run
    );
}
