//! Makes the pages of `docs/results` from the newest results of each campaign.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use fleetcal_evaluation::error::EvaluationError;
use fleetcal_evaluation::results::pages;

/// Makes the pages of a folder from the JSON lines in its folder `data`.
#[derive(Debug, Parser)]
#[command(name = "results")]
struct Arguments {
    /// Folder of the pages.
    #[arg(long, default_value = "docs/results")]
    folder: PathBuf,
}

fn main() -> ExitCode {
    match write(&Arguments::parse().folder) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(2)
        }
    }
}

fn write(folder: &Path) -> Result<(), EvaluationError> {
    for (name, page) in pages(&folder.join("data"))? {
        let path = folder.join(format!("{name}.md"));
        std::fs::write(&path, page).map_err(|source| EvaluationError::Written { path, source })?;
    }
    Ok(())
}
