//! Runs the evaluation and writes its report.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use fleetcal_evaluation::Evaluation;
use fleetcal_evaluation::extent::Extent;
use fleetcal_evaluation::study::recording::Source;

/// Runs the evaluation: exit status 1 if a figure misses its bound.
#[derive(Debug, Parser)]
#[command(name = "fleetcal-evaluation")]
struct Arguments {
    /// Folder for evaluation.md and its figures.
    #[arg(long)]
    out: PathBuf,
    /// Evaluated commit, for the report.
    #[arg(long, default_value = "unknown")]
    commit: String,
    /// A few seeds only: under three minutes.
    #[arg(long)]
    quick: bool,
    /// Studies by name; all of them by default.
    studies: Vec<String>,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let (extent, command) = if arguments.quick {
        (Extent::QUICK, "make evaluation-quick")
    } else {
        (Extent::FULL, "make evaluation")
    };
    let folder = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
    let evaluation = Evaluation {
        extent,
        only: arguments.studies,
        source: Source {
            recordings: folder("FLEETCAL_DATA").map(PathBuf::from),
            fleetcal: folder("FLEETCAL_BIN").map(PathBuf::from),
        },
        commit: arguments.commit,
        command,
    };
    let report = evaluation
        .run(|study| eprintln!("{study} …"))
        .and_then(|report| report.write(&arguments.out).map(|()| report));
    match report {
        Ok(report) => {
            for claim in report.short_of() {
                eprintln!(
                    "falls short: {} is {}, has to be {}",
                    claim.what, claim.seen, claim.bound
                );
            }
            ExitCode::from(u8::from(!report.short_of().is_empty()))
        }
        Err(error) => {
            eprintln!("{}", with_sources(&error));
            ExitCode::from(2)
        }
    }
}

/// Formats an error with its causes.
fn with_sources(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        text = format!("{text}: {cause}");
        source = cause.source();
    }
    text
}
