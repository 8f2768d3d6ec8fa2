//! Campaign of damaged inputs: `fleetcal-fuzz SECONDS PROGRESS [TARGET…]`.
//!
//! Each target gets SECONDS. The folder PROGRESS has the next seed of each, from which a later run
//! goes on, and the inputs that failed.

#![expect(
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "a campaign lasts as long as it is told, and prints what it found"
)]

use std::io::Error;
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use fleetcal_fuzz::targets::{TARGETS, Target};
use fleetcal_fuzz::{input_of, try_one};

/// Seeds after which the progress is written.
const WRITTEN_EVERY: u64 = 256;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let (Some(seconds), Some(progress)) = (arguments.next(), arguments.next()) else {
        println!("expected SECONDS PROGRESS [TARGET…]");
        return ExitCode::from(2);
    };
    let Ok(seconds) = seconds.parse() else {
        println!("SECONDS: got {seconds:?}, expected a number");
        return ExitCode::from(2);
    };
    let chosen: Vec<String> = arguments.collect();
    let is_chosen =
        |target: &&Target| chosen.is_empty() || chosen.iter().any(|name| name == target.name);
    let mut failed = 0;
    for target in TARGETS.iter().filter(is_chosen) {
        match campaign(target, Duration::from_secs(seconds), Path::new(&progress)) {
            Ok(count) => failed += count,
            Err(error) => {
                println!("{}: {error}", target.name);
                return ExitCode::from(74);
            }
        }
    }
    ExitCode::from(u8::from(failed > 0))
}

/// Reads damaged inputs for a time; returns how many failed.
fn campaign(target: &Target, lasts: Duration, progress: &Path) -> Result<u64, Error> {
    std::fs::create_dir_all(progress)?;
    let next = progress.join(format!("{}.seed", target.name));
    let first = std::fs::read_to_string(&next).ok();
    let first: u64 = first.and_then(|text| text.trim().parse().ok()).unwrap_or(0);
    let (seeds, scratch) = ((target.seeds)(), tempfile::tempdir()?);
    let (began, mut seed, mut failed) = (Instant::now(), first, 0);
    while began.elapsed() < lasts {
        let input = input_of(&seeds, seed);
        if let Err(failure) = try_one(target, Some(seed), &input, scratch.path()) {
            failed += 1;
            let file = progress.join(format!("{}-{seed}", target.name));
            std::fs::write(&file, &failure.input)?;
            println!(
                "{}: seed {seed} {}: {}",
                target.name,
                failure.what,
                file.display()
            );
        }
        seed += 1;
        if seed.is_multiple_of(WRITTEN_EVERY) {
            std::fs::write(&next, seed.to_string())?;
        }
    }
    std::fs::write(&next, seed.to_string())?;
    println!("{}: seeds {first} to {seed}, {failed} failed", target.name);
    Ok(failed)
}
