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

/// One finished run, as a line of a results file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finished {
    /// What was driven.
    pub cell: Cell,
    /// By the robot of which seed.
    pub seed: u64,
    /// How long it was driven and watched.
    #[serde(flatten)]
    pub watch: Watch,
    /// What it ended with.
    pub outcome: Outcome,
}

/// Cells and seeds, and the results of those that were run already.
#[derive(Debug, Default)]
pub struct Campaign {
    watch: Watch,
    finished: BTreeMap<(Cell, u64), Outcome>,
    results: Option<(PathBuf, File)>,
}

impl Campaign {
    /// A campaign whose robots are watched like this, without a results file.
    pub fn new(watch: Watch) -> Self {
        Self {
            watch,
            ..Self::default()
        }
    }

    /// The same with a results file: its runs are taken over, and new ones are appended. Runs that were
    /// watched otherwise are left alone. A last line that was cut off is run again.
    ///
    /// # Errors
    /// When the file can neither be read nor made.
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

    /// How many runs it knows the outcome of.
    #[cfg(test)]
    pub fn finished_runs(&self) -> usize {
        self.finished.len()
    }

    /// The outcomes of a cell, one for each seed in order; those not known yet are run.
    ///
    /// # Errors
    /// Whatever a run ends with, and when its result cannot be kept.
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

/// One line, in one write: runs of other threads cannot come in between.
fn append(path: &Path, mut file: &File, run: &Finished) -> Result<(), EvaluationError> {
    let failed = |source| EvaluationError::Written {
        path: path.to_owned(),
        source,
    };
    let mut line = serde_json::to_string(run).map_err(|error| failed(error.into()))?;
    line.push('\n');
    file.write_all(line.as_bytes()).map_err(failed)
}
