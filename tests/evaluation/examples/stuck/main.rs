//! Counts stuck values: a value of any status that stays more than four published sigmas off and is never
//! flagged.
//!
//!     stuck ROBOTS [FIRST_SEED]
//!
//! Each simulated robot drives twice, with a change and without. Where `FLEETCAL_DATA` names the folder of
//! the recordings, steps of the steering and the mount are put into those of real robots.

#![expect(clippy::print_stdout, reason = "the outcomes are what it is for")]

#[path = "../recordings/recorded.rs"]
mod recorded;
mod steps;

use std::env;
use std::path::Path;
use std::process::ExitCode;

use fleetcal_evaluation::error::EvaluationError;
use fleetcal_evaluation::stuck::{Outcome, robots, summary};
use rayon::prelude::*;

/// Reason why a drive has no outcome.
type Failure = Box<dyn std::error::Error + Send + Sync>;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("stuck: {failure}");
            ExitCode::from(2)
        }
    }
}

fn run() -> Result<(), Failure> {
    let mut arguments = env::args().skip(1).map(|argument| argument.parse::<u64>());
    let robots = arguments.next().transpose()?.unwrap_or(24);
    let first = arguments.next().transpose()?.unwrap_or(1);
    for is_changed in [true, false] {
        let outcomes: Result<Vec<_>, EvaluationError> = (first..first + robots)
            .into_par_iter()
            .map(|seed| robots::drive(seed, is_changed))
            .collect();
        show(if is_changed { "changed" } else { "unchanged" }, &outcomes?);
    }
    if let Some(data) = env::var_os("FLEETCAL_DATA") {
        let (stepped, halves) = steps::drive(Path::new(&data))?;
        show("stepped recordings", &stepped);
        show("parts of recordings", &halves);
    }
    Ok(())
}

fn show(title: &str, outcomes: &[(String, Outcome)]) {
    for (name, outcome) in outcomes {
        println!("{name}: {outcome}");
    }
    println!("{}", summary(title, outcomes));
}
