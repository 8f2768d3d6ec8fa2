//! Writes every bit that the estimator publishes over a corpus of drives, one file for each drive: values,
//! sigmas and covariance as the bits of their numbers, statuses, events and the rest in words.
//!
//!     same_bits FOLDER [DRIVES]
//!
//! The drives are simulated: each imperfection of the simulator in turn, with an incident in most. Where
//! `FLEETCAL_DATA` names the folder of the recordings, these are driven as well.
//! `tests/evaluation/same_bits.sh` compares the files of two commits.

mod drives;
mod incident;
mod lines;
#[path = "../recordings/recorded.rs"]
mod recorded;
mod recordings;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::{env, fs};

use rayon::prelude::*;

/// Simulated drives unless a number is given: each imperfection once.
const DRIVES: u64 = 49;

/// Reason why a drive has no lines.
type Failure = Box<dyn std::error::Error + Send + Sync>;

fn main() -> ExitCode {
    match write(env::args().skip(1)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("same_bits: {failure}");
            ExitCode::from(2)
        }
    }
}

fn write(mut arguments: impl Iterator<Item = String>) -> Result<(), Failure> {
    let usage = "expected a folder and, if wanted, the number of simulated drives";
    let folder = arguments.next().map(PathBuf::from).ok_or(usage)?;
    let drives = arguments.next().map_or(Ok(DRIVES), |n| n.parse())?;
    fs::create_dir_all(&folder)?;
    (0..drives).into_par_iter().try_for_each(|index| {
        let (name, lines) = drives::drive(index)?;
        write_drive(&folder, &name, &lines)
    })?;
    let data = env::var_os("FLEETCAL_DATA").filter(|data| !data.is_empty());
    let recordings = data.map(|data| recorded::of(Path::new(&data)));
    recordings
        .into_iter()
        .flatten()
        .par_bridge()
        .try_for_each(|recording| {
            write_drive(
                &folder,
                recording.name(),
                &recordings::lines_of(&recording)?,
            )
        })
}

fn write_drive(folder: &Path, name: &str, lines: &str) -> Result<(), Failure> {
    Ok(fs::write(folder.join(format!("{name}.txt")), lines)?)
}
