//! Stuck values: values of any status that stay more than four published sigmas off and are never flagged.

pub mod robots;

use std::fmt;

use fleetcal_estimator::estimate::{Change, ChangeKind};
use fleetcal_estimator::{Estimate, Parameter, Status};

use crate::drive::FOUR;
use crate::imperfect::FALSE_SIGMAS;

/// Time at the end over which a stuck value is off without a break, s.
const STAYS_S: f64 = 10.0;
/// Distance after a change from which a claim counts, m.
const LATE_M: f64 = 20.0;

/// Outcome of one drive.
#[derive(Debug, Default, Clone)]
pub struct Outcome {
    /// Time since which each of the four is off, s.
    off_since_s: [Option<f64>; 4],
    /// Time of the last estimate, s.
    now_s: f64,
    /// Distance at the change, m.
    changed_m: Option<f64>,
    /// Largest error of the last estimate, in published sigmas, and its parameter.
    pub worst: Option<(f64, Parameter)>,
    /// Number of estimates with a false claim; after a change only those from 20 m on.
    pub false_claims: usize,
    /// Time at which all four were converged first, s.
    pub converged_s: Option<f64>,
    /// Changes that were flagged although nothing had changed.
    pub alarms: usize,
    /// Distance from the change to its flag, m.
    pub flagged_m: Option<f64>,
    /// Faults that were flagged.
    pub faults: usize,
}

impl Outcome {
    /// Adds an estimate, with the error of each of its values.
    pub fn see(
        &mut self,
        estimate: &Estimate,
        error_of: impl Fn(Parameter) -> f64,
        has_changed: bool,
    ) {
        self.now_s = estimate.time_s;
        if has_changed {
            self.changed_m.get_or_insert(estimate.distance_m);
        }
        let counts = self
            .changed_m
            .is_none_or(|changed_m| estimate.distance_m - changed_m > LATE_M);
        let (mut is_false, mut is_converged) = (false, true);
        self.worst = None;
        for (off_since_s, parameter) in self.off_since_s.iter_mut().zip(FOUR) {
            let found = estimate.parameter(parameter);
            let sigmas = error_of(parameter).abs() / found.sigma;
            if self.worst.is_none_or(|(worst, _)| sigmas > worst) {
                self.worst = Some((sigmas, parameter));
            }
            let is_claimed = found.status == Status::Converged;
            is_converged &= is_claimed;
            if sigmas > FALSE_SIGMAS {
                off_since_s.get_or_insert(estimate.time_s);
                is_false |= is_claimed && counts;
            } else {
                *off_since_s = None;
            }
        }
        self.false_claims += usize::from(is_false);
        if is_converged {
            self.converged_s.get_or_insert(estimate.time_s);
        }
    }

    /// Adds a detection, at the distance driven so far.
    pub fn flag(&mut self, change: &Change, distance_m: f64) {
        match (change.kind, self.changed_m) {
            (ChangeKind::Fault, _) => self.faults += 1,
            (ChangeKind::CalibrationChanged, Some(changed_m)) => {
                self.flagged_m.get_or_insert(distance_m - changed_m);
            }
            (ChangeKind::CalibrationChanged, None) => self.alarms += 1,
            _ => {}
        }
    }

    /// True if a value was off until the end.
    pub fn is_off(&self) -> bool {
        let stays = |since_s: f64| self.now_s - since_s >= STAYS_S;
        self.off_since_s
            .iter()
            .flatten()
            .any(|since_s| stays(*since_s))
    }

    /// True if a value was off until the end, and no change was flagged.
    pub fn is_stuck(&self) -> bool {
        self.flagged_m.is_none() && self.is_off()
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        let verdict = match (self.is_stuck(), self.is_off()) {
            (true, _) => "stuck",
            (false, true) => "off",
            (false, false) => "within its sigmas",
        };
        write!(out, "{verdict}")?;
        if let Some((sigmas, parameter)) = self.worst {
            write!(out, ", {} {sigmas:.1} sigmas off", parameter.name())?;
        }
        if let Some(flagged_m) = self.flagged_m {
            write!(out, ", flagged after {flagged_m:.1} m")?;
        }
        for (count, what) in [
            (self.false_claims, "false claims"),
            (self.alarms, "false alarms"),
            (self.faults, "faults"),
        ] {
            if count > 0 {
                write!(out, ", {count} {what}")?;
            }
        }
        Ok(())
    }
}

/// Summarises the outcomes of one kind of drives.
pub fn summary(title: &str, outcomes: &[(String, Outcome)]) -> String {
    let number = |is: fn(&Outcome) -> bool| outcomes.iter().filter(|(_, one)| is(one)).count();
    let median = |of: fn(&Outcome) -> Option<f64>| {
        let mut all: Vec<f64> = outcomes.iter().filter_map(|(_, one)| of(one)).collect();
        all.sort_by(f64::total_cmp);
        let middle = all
            .get(all.len() / 2)
            .map_or("-".to_owned(), |middle| format!("{middle:.1}"));
        (all.len(), middle)
    };
    let (flagged, after_m) = median(|one| one.flagged_m);
    let (converged, at_s) = median(|one| one.converged_s);
    format!(
        "{title}: {} drives, stuck {}, off at the end {}, flagged {flagged} (median {after_m} m); drives with a false \
         claim {}, with a false alarm {}, with a fault {}; all converged {converged} (median {at_s} s)",
        outcomes.len(),
        number(Outcome::is_stuck),
        number(Outcome::is_off),
        number(|one| one.false_claims > 0),
        number(|one| one.alarms > 0),
        number(|one| one.faults > 0),
    )
}
