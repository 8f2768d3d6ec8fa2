//! Joining checks before simulated robots: which wrong inputs they name, and that they name nothing of
//! robots that are right.

mod expected;
mod robot;

use fleetcal_checks::Finding;
use fleetcal_robot::simulator::{SimulationConfig, WrongInput};
use rayon::prelude::*;

use crate::error::EvaluationError;
use crate::imperfect::{Cell, Flaw, Road, Scenario, Sensor, robot};
use crate::results::{Figure, Value};

pub use expected::{expected, true_of};
pub use robot::{Checked, drive};

/// Length of a drive, s.
pub const DRIVE_S: f64 = 100.0;

/// A wrong input before the checks.
#[derive(Debug, Clone)]
pub struct Told {
    /// The wrong input.
    pub input: WrongInput,
    /// The finding of a cause that is right.
    pub right: Option<Finding>,
    /// Findings of others.
    pub others: Vec<Finding>,
}

/// The clean robot of a seed with a wrong input, or none.
///
/// # Errors
/// Names the setting that is refused.
pub fn told(input: WrongInput, seed: u64) -> Result<Told, EvaluationError> {
    let needs_scans = input.needs_scans().unwrap_or(false);
    let sensor = if needs_scans {
        Sensor::Scans
    } else {
        Sensor::Poses
    };
    let named = drive(clean(seed, sensor), &[input], DRIVE_S)?.named();
    let is_right = |finding: &Finding| {
        finding
            .cause
            .is_some_and(|cause| expected(input).contains(&cause))
    };
    let (right, others): (Vec<_>, Vec<_>) = named.into_iter().partition(is_right);
    Ok(Told {
        input,
        right: right
            .into_iter()
            .min_by(|a, b| a.after_s.total_cmp(&b.after_s)),
        others,
    })
}

fn clean(seed: u64, sensor: Sensor) -> SimulationConfig {
    let cell = Cell {
        flaw: Flaw::Clean,
        road: Road::Eight,
        scenario: Scenario::Unchanged,
        sensor,
    };
    robot(cell, seed, None).0.simulation
}

/// Returns the causes named of an imperfect robot whose inputs are right.
///
/// # Errors
/// Names the setting that is refused.
pub fn named_of(flaw: Flaw, road: Road, seed: u64) -> Result<Vec<Finding>, EvaluationError> {
    let sensor = if flaw.needs_scans() {
        Sensor::Scans
    } else {
        Sensor::Poses
    };
    let cell = Cell {
        flaw,
        road,
        scenario: Scenario::Unchanged,
        sensor,
    };
    let config = robot(cell, seed, None).0.simulation;
    Ok(drive(config, &[], DRIVE_S)?.named())
}

/// Figures of all wrong inputs over seeds.
///
/// # Errors
/// Whatever a drive ends with.
pub fn matrix(
    seeds: u64,
    wants: impl Fn(WrongInput) -> bool,
    mut say: impl FnMut(&Told),
) -> Result<Vec<Figure>, EvaluationError> {
    let mut figures = Vec::new();
    for input in WrongInput::ALL.iter().filter(|input| wants(**input)) {
        let all: Result<Vec<Told>, _> = (1..=seeds)
            .into_par_iter()
            .map(|seed| told(*input, seed))
            .collect();
        let all = all?;
        all.iter().for_each(&mut say);
        let mut figure = |figure: &str, value| {
            figures.push(Figure {
                table: "Wrong inputs".into(),
                row: format!("{} (`{}`)", input.words(), input.name()),
                figure: figure.into(),
                value,
            });
        };
        let named: Vec<&Finding> = all.iter().filter_map(|told| told.right.as_ref()).collect();
        let share = |count: usize| Value::Share {
            count: count as u64,
            of: seeds,
        };
        let most = |value: fn(&Finding) -> f64, unit: &str| Value::Quantity {
            value: named.iter().map(|of| value(of)).reduce(f64::max),
            unit: unit.into(),
            of: named.len() as u64,
        };
        figure("named", share(named.len()));
        figure("longest way", most(|of| of.after_m, "m"));
        figure("longest time", most(|of| of.after_s, "s"));
        figure(
            "with another cause",
            share(all.iter().filter(|told| !told.others.is_empty()).count()),
        );
    }
    Ok(figures)
}

/// Figures of robots whose inputs are right: every imperfection at both strengths, on every route.
///
/// # Errors
/// Whatever a drive ends with.
pub fn correct(
    seeds: u64,
    wants: impl Fn(Flaw) -> bool,
    mut say: impl FnMut(Flaw, Road, u64, &Finding),
) -> Result<Vec<Figure>, EvaluationError> {
    let mut figures = Vec::new();
    for flaw in Flaw::all().into_iter().filter(|flaw| wants(*flaw)) {
        for road in Road::ALL {
            let all: Result<Vec<_>, EvaluationError> = (1..=seeds)
                .into_par_iter()
                .map(|seed| Ok((seed, named_of(flaw, road, seed)?)))
                .collect();
            let all = all?;
            let is_true =
                |of: &Finding| of.cause.is_some_and(|cause| true_of(flaw).contains(&cause));
            for (seed, finding) in all
                .iter()
                .flat_map(|(seed, named)| named.iter().map(move |of| (seed, of)))
            {
                say(flaw, road, *seed, finding);
            }
            let mut share = |figure: &str, count: usize| {
                figures.push(Figure {
                    table: "Robots whose inputs are right".into(),
                    row: format!("{} {}", flaw.name(), flaw.strength()),
                    figure: format!("{}, {figure}", road.name()),
                    value: Value::Share {
                        count: count as u64,
                        of: seeds,
                    },
                });
            };
            share(
                "named wrongly",
                all.iter()
                    .filter(|(_, named)| !named.iter().all(is_true))
                    .count(),
            );
            if !true_of(flaw).is_empty() {
                share(
                    "named rightly",
                    all.iter()
                        .filter(|(_, named)| named.iter().any(is_true))
                        .count(),
                );
            }
        }
    }
    Ok(figures)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes of a robot's checks beside its odometry.
    const MEMORY_BYTES_MAX: usize = 20_000;

    #[test]
    fn every_wrong_input_is_named_and_by_its_own_cause() {
        // What has the same origin may be said twice.
        let beside = [
            fleetcal_checks::Cause::Refused,
            fleetcal_checks::Cause::SteeringDegrees,
        ];
        for input in WrongInput::ALL {
            let told = told(*input, 3).unwrap();
            let right = told
                .right
                .unwrap_or_else(|| panic!("{}: {:?}", input.name(), told.others));
            let is_soon = right.after_m < 60.0 || right.after_s < 10.0;
            assert!(is_soon, "{}: {right:?}", input.name());
            let is_beside = |of: &Finding| of.cause.is_some_and(|cause| beside.contains(&cause));
            assert!(
                told.others.iter().all(is_beside),
                "{}: {:?}",
                input.name(),
                told.others
            );
        }
    }

    #[test]
    fn nothing_is_named_of_typical_robots_whose_inputs_are_right() {
        for road in Road::ALL {
            for flaw in [Flaw::Clean, Flaw::AllTypical] {
                for seed in 1..=2 {
                    let named = named_of(flaw, road, seed).unwrap();
                    assert!(
                        named.is_empty(),
                        "{} {} {seed}: {named:?}",
                        flaw.name(),
                        road.name()
                    );
                }
            }
        }
    }

    #[test]
    fn the_checks_of_a_robot_take_twenty_kilobytes() {
        for sensor in [Sensor::Poses, Sensor::Scans] {
            let checked = drive(clean(1, sensor), &[], 70.0).unwrap();
            let bytes = checked.checks.memory_bytes();
            assert!(bytes <= MEMORY_BYTES_MAX, "{bytes} bytes");
        }
    }

    #[test]
    fn a_drive_cut_anywhere_names_nothing_that_the_whole_one_does_not() {
        for cut_s in [4.0, 9.0, 17.0, 26.0, 41.0] {
            let named = drive(clean(2, Sensor::Poses), &[], cut_s).unwrap().named();
            assert!(named.is_empty(), "{cut_s}: {named:?}");
        }
    }
}
