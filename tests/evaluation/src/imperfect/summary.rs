//! Summary of a cell's runs, pooled.

use fleetcal_estimator::estimate::{Cause, ChangeKind};

use super::cell::{Cell, InjectedChange, Place, Scenario};
use super::outcome::{ChangeOutcome, ClaimsOutcome, Flagged, Outcome, Snapshot};
use super::run::CLAIMS_AT_S;
use crate::results::{Figure, Value};
use crate::statistics::{Proportion, Rate, mean};

/// Largest errors of a robot with an imperfection after 180 s: x, y, yaw, steering offset.
pub const BOUNDS: [f64; 4] = [
    0.003,
    0.005,
    0.03 / 180.0 * std::f64::consts::PI,
    0.02 / 180.0 * std::f64::consts::PI,
];
/// Time at which convergence and errors are evaluated, s.
const CONVERGED_AT_S: f64 = 180.0;

/// Pooled outcomes of one cell, or of many.
#[derive(Debug, Clone, Default)]
pub struct Summary {
    claims: Vec<ClaimsOutcome>,
    changes: Vec<(InjectedChange, ChangeOutcome)>,
}

impl Summary {
    /// Adds the outcomes of a cell.
    pub fn add(&mut self, cell: Cell, outcomes: &[Outcome]) {
        for outcome in outcomes {
            match (outcome, cell.scenario) {
                (Outcome::Claims(claims), _) => self.claims.push(claims.clone()),
                (Outcome::Change(change), Scenario::Changed(injected, _)) => {
                    self.changes.push((injected, ChangeOutcome::clone(change)));
                }
                (Outcome::Change(_), Scenario::Unchanged) => {}
            }
        }
    }

    /// Makes the pooled outcomes of one cell.
    pub fn of(cell: Cell, outcomes: &[Outcome]) -> Self {
        let mut summary = Self::default();
        summary.add(cell, outcomes);
        summary
    }

    fn snapshots_at(&self, at_s: f64) -> impl Iterator<Item = &Snapshot> {
        let at = move |snapshot: &&Snapshot| (snapshot.at_s - at_s).abs() < 5.0;
        self.claims
            .iter()
            .filter_map(move |run| run.snapshots.iter().find(at))
    }

    /// Counts the runs with a false claim at a time, of those that got there.
    pub fn false_claims_at(&self, at_s: f64) -> Proportion {
        Proportion::count(self.snapshots_at(at_s), |snapshot| snapshot.is_false())
    }

    /// Counts the runs with a false claim at one of the four times.
    pub fn false_claims(&self) -> Proportion {
        let at_any = |run: &&ClaimsOutcome| run.snapshots.iter().any(Snapshot::is_false);
        Proportion::count(self.claims.iter(), |run| at_any(run))
    }

    /// Counts the runs with a false claim in any published estimate.
    pub fn false_claims_ever(&self) -> Proportion {
        Proportion::count(self.claims.iter(), |run| {
            run.worst_claim > super::outcome::FALSE_SIGMAS
        })
    }

    /// Returns the largest error in sigmas of a converged parameter, at one of the four times.
    pub fn worst_claim(&self) -> f64 {
        let all = self.claims.iter().flat_map(|run| &run.snapshots);
        all.map(Snapshot::worst_claim).fold(0.0, f64::max)
    }

    /// Counts the runs with all four converged after 180 s.
    pub fn converged(&self) -> Proportion {
        Proportion::count(self.snapshots_at(CONVERGED_AT_S), |s| s.all_converged())
    }

    /// Counts the runs with all four converged after 180 s and within 3 mm, 5 mm, 0.03° and 0.02°.
    pub fn converged_within_bounds(&self) -> Proportion {
        Proportion::count(self.snapshots_at(CONVERGED_AT_S), |snapshot| {
            let sizes = snapshot.errors.iter().zip(BOUNDS);
            snapshot.all_converged() && sizes.into_iter().all(|(e, bound)| e.abs() <= bound)
        })
    }

    /// Returns the errors after 180 s, root of the mean square: x, y (m), yaw, steering offset
    /// (rad).
    pub fn rms_errors(&self) -> [f64; 4] {
        [0, 1, 2, 3].map(|i| {
            let squares: Vec<_> = self
                .snapshots_at(CONVERGED_AT_S)
                .map(|snapshot| snapshot.errors[i].powi(2))
                .collect();
            mean(&squares).abs().sqrt()
        })
    }

    /// Returns the median time until all four are converged first, s; infinite if half of the runs
    /// never get there.
    pub fn converged_after_s(&self) -> f64 {
        let mut times: Vec<_> = self
            .claims
            .iter()
            .map(|run| run.converged_s.unwrap_or(f64::INFINITY))
            .collect();
        quantile(&mut times, 0.5)
    }

    /// Returns the mean normalised error squared of the published estimates; its expectation is 4.
    pub fn nees_at(&self, at_s: f64) -> f64 {
        mean(&self.snapshots_at(at_s).map(|s| s.nees).collect::<Vec<_>>())
    }

    /// Returns the rate of changes and faults detected on unchanged robots and before a change,
    /// 1/h.
    pub fn false_changes(&self) -> Rate {
        let hours = |seconds: f64| seconds / 3600.0;
        let unchanged = self
            .claims
            .iter()
            .map(|run| (run.flagged.len(), run.length_s));
        let before = self
            .changes
            .iter()
            .map(|(_, run)| (run.too_early.len(), run.changed_s));
        let mut rate = Rate::default();
        for (count, length_s) in unchanged.chain(before) {
            rate.count += count as u64;
            rate.hours += hours(length_s);
        }
        rate
    }

    /// Counts the changes that were not detected within the 40 m after them.
    pub fn missed(&self) -> Proportion {
        Proportion::count(self.changes.iter(), |(_, run)| run.flag.is_none())
    }

    /// Counts the detected changes with another cause.
    pub fn wrong_cause(&self) -> Proportion {
        let flags = self
            .changes
            .iter()
            .filter_map(|(injected, run)| Some((*injected, run.flag?.0)));
        Proportion::count(flags, |(injected, flag)| !is_right(*injected, flag))
    }

    /// Returns the distance from a change to its detection with the right cause, m, by which
    /// `share` of the changes are detected. Infinite if fewer are detected at all.
    pub fn flagged_after_m(&self, share: f64) -> f64 {
        let mut ways: Vec<_> = self
            .changes
            .iter()
            .map(|(injected, run)| match run.flag {
                Some((flag, way_m)) if is_right(*injected, &flag) => way_m,
                _ => f64::INFINITY,
            })
            .collect();
        quantile(&mut ways, share)
    }

    /// Returns the distance from a change until the robot's heading had turned by 45°, m, by which
    /// `share` of the robots have turned. Infinite if fewer turned at all.
    pub fn turned_after_m(&self, share: f64) -> f64 {
        let ways = self.changes.iter();
        let mut ways: Vec<_> = ways
            .map(|(_, run)| run.turned_m.unwrap_or(f64::INFINITY))
            .collect();
        quantile(&mut ways, share)
    }

    /// Counts the runs with a false claim more than 20 m after a change.
    pub fn false_claims_after_change(&self) -> Proportion {
        let driven = self.changes.iter().filter(|(_, run)| run.told_late[0] > 0);
        Proportion::count(driven, |(_, run)| run.told_late[1] > 0)
    }

    /// Returns the figures of pooled cells, at their place among the results.
    pub fn figures(&self, place: &Place) -> Vec<Figure> {
        let figures = if self.changes.is_empty() {
            self.claim_figures()
        } else {
            self.change_figures()
        };
        let figures = figures.into_iter().map(|(figure, value)| Figure {
            table: place.table.clone(),
            row: place.row.clone(),
            figure: figure.to_owned(),
            value,
        });
        figures.collect()
    }

    fn claim_figures(&self) -> Vec<(&'static str, Value)> {
        let of = self.claims.len() as u64;
        vec![
            (
                "false claim at 60, 120, 180 or 600 s",
                share(self.false_claims()),
            ),
            ("false claim at any time", share(self.false_claims_ever())),
            ("worst claim", quantity(self.worst_claim(), "σ", of)),
            ("converged after 180 s", share(self.converged())),
            (
                "false changes an hour",
                quantity(self.false_changes().an_hour(), "/h", of),
            ),
        ]
    }

    fn change_figures(&self) -> Vec<(&'static str, Value)> {
        let of = self.changes.len() as u64;
        vec![
            (
                "median way to the flag",
                quantity(self.flagged_after_m(0.5), "m", of),
            ),
            ("95 %", quantity(self.flagged_after_m(0.95), "m", of)),
            ("not flagged within 40 m", share(self.missed())),
            ("another cause", share(self.wrong_cause())),
            (
                "false claim from 20 m on",
                share(self.false_claims_after_change()),
            ),
        ]
    }

    /// Formats the cell in one line.
    pub fn line(&self, cell: Cell) -> String {
        match cell.scenario {
            Scenario::Unchanged => self.claims_line(cell),
            Scenario::Changed(..) => self.change_line(cell),
        }
    }

    fn claims_line(&self, cell: Cell) -> String {
        let at: Vec<_> = CLAIMS_AT_S
            .iter()
            .filter(|at_s| self.snapshots_at(**at_s).next().is_some())
            .map(|at_s| {
                let (claims, nees) = (self.false_claims_at(*at_s), self.nees_at(*at_s));
                format!("{at_s:.0}s {}/{} z2 {nees:.2}", claims.count, claims.of)
            })
            .collect();
        let [x_m, y_m, yaw_rad, steering_rad] = self.rms_errors();
        format!(
            "{cell}: false {} [{}] ever {} worst {:.1}σ | conv@180 {} in bounds {} after {:.0}s | \
             rms {:.1}mm {:.1}mm {:.3}° {:.3}° | false changes {}",
            self.false_claims(),
            at.join(", "),
            self.false_claims_ever(),
            self.worst_claim(),
            self.converged(),
            self.converged_within_bounds(),
            self.converged_after_s(),
            1e3 * x_m,
            1e3 * y_m,
            yaw_rad.to_degrees(),
            steering_rad.to_degrees(),
            self.false_changes(),
        )
    }

    fn change_line(&self, cell: Cell) -> String {
        format!(
            "{cell}: median {:.1}m 95% {:.1}m | turned by 45° {:.1}m {:.1}m | missed {} wrong cause {} | false claim >20m later {} \
             | too early {}",
            self.flagged_after_m(0.5),
            self.flagged_after_m(0.95),
            self.turned_after_m(0.5),
            self.turned_after_m(0.95),
            self.missed(),
            self.wrong_cause(),
            self.false_claims_after_change(),
            self.false_changes(),
        )
    }
}

fn share(proportion: Proportion) -> Value {
    Value::Share {
        count: proportion.count,
        of: proportion.of,
    }
}

fn quantity(value: f64, unit: &str, of: u64) -> Value {
    Value::Quantity {
        value: Some(value).filter(|value| value.is_finite()),
        unit: unit.to_owned(),
        of,
    }
}

/// True if a detection names the injected change.
fn is_right(injected: InjectedChange, flag: &Flagged) -> bool {
    let expected = match injected {
        InjectedChange::Steering => Cause::Steering,
        InjectedChange::MountYaw | InjectedChange::MountMoved | InjectedChange::MountSideways => {
            Cause::LidarMount
        }
    };
    flag.kind == ChangeKind::CalibrationChanged && flag.cause == expected
}

/// Returns the value that `share` of the values do not exceed; infinite without values.
fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let place = (share * values.len() as f64).ceil().max(1.0) as usize - 1;
    values.get(place).copied().unwrap_or(f64::INFINITY)
}
