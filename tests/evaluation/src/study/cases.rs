//! Calibration runs of one case over many seeds, and what they end with.

use fleetcal_estimator::{Estimate, Status};
use fleetcal_robot::simulator::TrueParameters;
use rayon::prelude::*;

use crate::drive::{Driven, FOUR, Robot, drive, error_of, nees, truth_of};
use crate::error::EvaluationError;
use crate::paper::{Converged, POSITION_BOUND_M, STEERING_BOUND_DEG, YAW_BOUND_DEG};
use crate::report::{Section, Table};
use crate::statistics::{largest, mean, spread};

/// Column names of the four, with units.
pub const COLUMNS: [&str; 4] = ["x, m", "y, m", "yaw, °", "steering, °"];

/// Outcome of the runs of one case: for each of the four, one number a seed, m and degrees.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Truth.
    pub truth: [f64; 4],
    /// Estimates.
    pub values: [Vec<f64>; 4],
    /// Estimates minus truth.
    pub errors: [Vec<f64>; 4],
    /// Claimed standard deviations.
    pub sigmas: [Vec<f64>; 4],
    /// Normalised errors squared, 4 degrees of freedom.
    pub nees: Vec<f64>,
    /// Number of converged ones among the four, over all seeds.
    pub converged: usize,
    /// Changes that were detected although nothing changed.
    pub false_alarms: usize,
}

/// Drives a case with every seed, on all cores.
///
/// # Errors
/// The error of a run.
pub fn runs(
    seeds: &[u64],
    duration_s: f64,
    robot: impl Fn(u64) -> Robot + Sync,
) -> Result<Vec<Driven>, EvaluationError> {
    let each = |&seed: &u64| drive(robot(seed), duration_s);
    seeds.par_iter().map(each).collect()
}

/// Returns the last estimate of a run.
///
/// # Errors
/// When there are no estimates.
pub fn last<'a>(
    study: &'static str,
    seed: u64,
    run: &'a Driven,
) -> Result<&'a (Estimate, TrueParameters), EvaluationError> {
    run.estimates.last().ok_or(EvaluationError::Missing {
        study,
        seed,
        missing: "estimate",
    })
}

impl Outcome {
    /// Makes the outcome of runs.
    ///
    /// # Errors
    /// When a run has no estimate.
    pub fn of(study: &'static str, runs: &[Driven]) -> Result<Self, EvaluationError> {
        let mut outcome = Self {
            truth: [0.0; 4],
            values: Default::default(),
            errors: Default::default(),
            sigmas: Default::default(),
            nees: Vec::new(),
            converged: 0,
            false_alarms: 0,
        };
        for (seed, run) in (1..).zip(runs) {
            let (estimate, truth) = last(study, seed, run)?;
            for (i, (parameter, unit)) in FOUR.into_iter().zip(SHOWN).enumerate() {
                let found = estimate.parameter(parameter);
                outcome.truth[i] = unit * truth_of(parameter, truth);
                outcome.values[i].push(unit * found.value);
                outcome.errors[i].push(unit * error_of(parameter, found.value, truth));
                outcome.sigmas[i].push(unit * found.sigma);
                outcome.converged += usize::from(found.status == Status::Converged);
            }
            outcome.nees.extend(nees(&run.calibrator, truth));
            outcome.false_alarms += run.changes.len();
        }
        Ok(outcome)
    }

    /// Returns the largest error of each of the four.
    pub fn worst(&self) -> [f64; 4] {
        [0, 1, 2, 3].map(|i| largest(&self.errors[i]))
    }

    /// Adds the rows of the case: the paper's, the truth, ours.
    pub fn rows(&self, table: &mut Table, name: &str, paper: &Converged) {
        let each = |shown: &dyn Fn(usize) -> f64| [0, 1, 2, 3].map(shown);
        let seeds = self.nees.len();
        table.row(cells(&format!("*{name}: paper's estimate*"), paper, ITALIC));
        table.row(cells(&format!("{name}: truth"), &self.truth, PLAIN));
        table.row(cells(
            &format!("fleetcal, mean of {seeds}"),
            &each(&|i| mean(&self.values[i])),
            PLAIN,
        ));
        table.row(cells(
            "fleetcal, spread",
            &each(&|i| spread(&self.values[i])),
            PLAIN,
        ));
        table.row(cells(
            "fleetcal, claimed sigma",
            &each(&|i| mean(&self.sigmas[i])),
            PLAIN,
        ));
        table.row(cells("**fleetcal, worst error**", &self.worst(), BOLD));
    }
}

/// Factors from SI units to those shown: m, m, degrees, degrees.
pub const SHOWN: [f64; 4] = [
    1.0,
    1.0,
    180.0 / std::f64::consts::PI,
    180.0 / std::f64::consts::PI,
];

/// Mark around our numbers in a table.
pub const PLAIN: &str = "";
/// Mark around the paper's numbers.
pub const ITALIC: &str = "*";
/// Mark around emphasised numbers.
pub const BOLD: &str = "**";

/// Formats a row's name and its four numbers between marks.
pub fn cells(name: &str, four: &[f64; 4], mark: &str) -> Vec<String> {
    let [x, y, yaw, steering] = four;
    let positions = [x, y].map(|m| format!("{mark}{m:.4}{mark}"));
    let angles = [yaw, steering].map(|deg| format!("{mark}{deg:.3}{mark}"));
    let name = std::iter::once(name.to_owned());
    name.chain(positions).chain(angles).collect()
}

/// Claims a tenth of the paper's spread for a study.
pub fn hold_to_a_tenth(section: &mut Section, outcomes: &[&Outcome]) {
    let worst = |i: usize| {
        let all = outcomes.iter().map(|outcome| outcome.worst()[i]);
        all.fold(0.0, f64::max)
    };
    let millimetres = |m: f64| format!("{:.2} mm", 1e3 * m);
    let degrees = |deg: f64| format!("{deg:.4}°");
    section.at_most("worst error of x", worst(0), POSITION_BOUND_M, millimetres);
    section.at_most("worst error of y", worst(1), POSITION_BOUND_M, millimetres);
    section.at_most("worst error of yaw", worst(2), YAW_BOUND_DEG, degrees);
    section.at_most(
        "worst error of steering",
        worst(3),
        STEERING_BOUND_DEG,
        degrees,
    );
}

/// Returns a further remark on the runs, in a sentence.
pub fn remark(outcomes: &[&Outcome]) -> String {
    let all_nees: Vec<_> = outcomes
        .iter()
        .flat_map(|o| o.nees.iter().copied())
        .collect();
    let converged: usize = outcomes.iter().map(|o| o.converged).sum();
    let alarms: usize = outcomes.iter().map(|o| o.false_alarms).sum();
    format!(
        "Of {} values {converged} were called converged at the end; {alarms} changes were flagged, \
         where nothing changed. The mean NEES over all runs is {:.2}; 4 is right, less is cautious.",
        4 * all_nees.len(),
        mean(&all_nees)
    )
}
