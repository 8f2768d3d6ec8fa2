//! Runs cells over seeds on all cores, and goes on where it was interrupted.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::cell::Cell;
use super::outcome::Outcome;
use super::run::{Watch, run};
use crate::error::EvaluationError;

/// Finished run, as a line of a results file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finished {
    /// Cell of the run.
    pub cell: Cell,
    /// Seed of the robot.
    pub seed: u64,
    /// Duration and observation of the run.
    #[serde(flatten)]
    pub watch: Watch,
    /// Outcome of the run.
    pub outcome: Outcome,
}

/// Cells and seeds, and the results of finished runs.
#[derive(Debug, Default)]
pub struct Campaign {
    watch: Watch,
    finished: BTreeMap<(Cell, u64), Outcome>,
    results: Option<(PathBuf, File)>,
}

impl Campaign {
    /// Makes a campaign with this observation, without a results file.
    pub fn new(watch: Watch) -> Self {
        Self {
            watch,
            ..Self::default()
        }
    }

    /// Adds a results file: its runs are reused, and new ones are appended. Runs with another
    /// observation are ignored. A truncated last line is run again.
    ///
    /// # Errors
    /// When the file can neither be read nor created.
    pub fn resumed(watch: Watch, path: &Path) -> Result<Self, EvaluationError> {
        let failed = |source| EvaluationError::Written {
            path: path.to_owned(),
            source,
        };
        let mut campaign = Self::new(watch);
        if path.exists() {
            for line in BufReader::new(File::open(path).map_err(failed)?).lines() {
                let line = line.map_err(failed)?;
                let Ok(run) = serde_json::from_str::<Finished>(&line) else {
                    continue;
                };
                if run.watch == watch {
                    campaign.finished.insert((run.cell, run.seed), run.outcome);
                }
            }
        }
        let mut file = OpenOptions::new()
            .create(true)
            .append(true)
            .open(path)
            .map_err(failed)?;
        // What follows a line that was cut off begins on its own line.
        writeln!(file).map_err(failed)?;
        campaign.results = Some((path.to_owned(), file));
        Ok(campaign)
    }

    /// Returns the number of runs with a known outcome.
    #[cfg(test)]
    pub fn finished_runs(&self) -> usize {
        self.finished.len()
    }

    /// Returns the outcomes of a cell, one for each seed in order; unknown ones are run.
    ///
    /// # Errors
    /// The error of a run, or of keeping its result.
    pub fn outcomes(&mut self, cell: Cell, seeds: &[u64]) -> Result<Vec<Outcome>, EvaluationError> {
        let missing: Vec<u64> = seeds
            .iter()
            .copied()
            .filter(|seed| !self.finished.contains_key(&(cell, *seed)))
            .collect();
        let results = self.results.as_ref();
        let watch = self.watch;
        let new: Result<Vec<_>, EvaluationError> = missing
            .into_par_iter()
            .map(|seed| {
                let outcome = run(cell, seed, watch)?;
                let run = Finished {
                    cell,
                    seed,
                    watch,
                    outcome,
                };
                results.map_or(Ok(()), |(path, file)| append(path, file, &run))?;
                Ok((seed, run.outcome))
            })
            .collect();
        let new = new?
            .into_iter()
            .map(|(seed, outcome)| ((cell, seed), outcome));
        self.finished.extend(new);
        let known = |seed: &u64| self.finished.get(&(cell, *seed)).cloned();
        Ok(seeds.iter().filter_map(known).collect())
    }
}

/// Appends one line in one write: runs of other threads cannot come in between.
fn append(path: &Path, mut file: &File, run: &Finished) -> Result<(), EvaluationError> {
    let failed = |source| EvaluationError::Written {
        path: path.to_owned(),
        source,
    };
    let mut line = serde_json::to_string(run).map_err(|error| failed(error.into()))?;
    line.push('\n');
    file.write_all(line.as_bytes()).map_err(failed)
}
