//! Runs the joining checks before robots with wrong inputs, and before imperfect robots that are right.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use fleetcal_evaluation::error::EvaluationError;
use fleetcal_evaluation::joining;
use fleetcal_evaluation::results::{Origin, Results};

/// Tells which wrong inputs the joining checks name, and after how many metres, and what they name of
/// imperfect robots whose inputs are right.
#[derive(Debug, Parser)]
#[command(name = "joining_checks")]
struct Arguments {
    /// Robots of each wrong input.
    #[arg(long, default_value_t = 5)]
    seeds: u64,
    /// Robots of each imperfection and route.
    #[arg(long, default_value_t = 5)]
    correct_seeds: u64,
    /// Imperfections by name; every one when none is given.
    #[arg(long, value_delimiter = ',')]
    only: Vec<String>,
    /// Wrong inputs by name; every one when none is given.
    #[arg(long, value_delimiter = ',')]
    wrong: Vec<String>,
    /// Writes the figures into this file of `docs/results/data`, as JSON lines.
    #[arg(long, requires = "commit", requires = "date", conflicts_with_all = ["only", "wrong"])]
    figures: Option<PathBuf>,
    /// Commit that is measured, for the figures.
    #[arg(long)]
    commit: Option<String>,
    /// Day of the run, for the figures.
    #[arg(long)]
    date: Option<String>,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), EvaluationError> {
    let mut figures = joining::matrix(
        arguments.seeds,
        |input| wants(&arguments.wrong, input.name()),
        |told| {
            let right = told.right.as_ref().map_or_else(
                || "not named".to_owned(),
                |of| format!("{:.1} m {:.1} s: {}", of.after_m, of.after_s, of.seen),
            );
            say(&format!("{}: {right}", told.input.name()));
            for other in &told.others {
                say(&format!(
                    "    also {:?} after {:.1} m: {}",
                    other.cause, other.after_m, other.seen
                ));
            }
        },
    )?;
    figures.extend(joining::correct(
        arguments.correct_seeds,
        |flaw| wants(&arguments.only, flaw.name()),
        |flaw, road, seed, finding| {
            say(&format!(
                "{} {} {} {seed}: {:?} after {:.1} m: {}",
                flaw.name(),
                flaw.strength(),
                road.name(),
                finding.cause,
                finding.after_m,
                finding.seen
            ));
        },
    )?);
    let Some(path) = &arguments.figures else {
        return Ok(());
    };
    let results = Results {
        origin: Origin {
            campaign: "joining_checks".into(),
            title: "Joining checks".into(),
            commit: arguments.commit.clone().unwrap_or_default(),
            date: arguments.date.clone().unwrap_or_default(),
            command: format!(
                "joining_checks --seeds {} --correct-seeds {}",
                arguments.seeds, arguments.correct_seeds
            ),
        },
        figures,
    };
    let failed = |source| EvaluationError::Written {
        path: path.clone(),
        source,
    };
    let lines = results.lines().map_err(|error| failed(error.into()))?;
    std::fs::write(path, lines).map_err(failed)
}

fn wants(only: &[String], name: &str) -> bool {
    only.is_empty() || only.iter().any(|one| one == name)
}

#[expect(clippy::print_stdout, reason = "the lines are what the command is for")]
fn say(line: &str) {
    println!("{line}");
}
