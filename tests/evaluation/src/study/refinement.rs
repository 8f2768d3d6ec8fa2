//! Study 6c: wheelbase, speed scale, delay and steering gain, refined together with the rest.

use fleetcal_estimator::settings::Freedom;
use fleetcal_estimator::{EstimatorSettings, Parameter};
use fleetcal_model::Unit;

use super::cases::{last, runs};
use crate::drive::{Driven, Robot, error_of, nees};
use crate::error::EvaluationError;
use crate::extent::Extent;
use crate::report::{Section, Table};
use crate::robots::{mount, tugger};
use crate::statistics::{mean, rms};

/// Shown quantities: parameter, heading, factor from SI.
const SHOWN: [(Parameter, &str, f64); 8] = [
    (Parameter::LidarX, "x, mm", 1e3),
    (Parameter::LidarY, "y, mm", 1e3),
    (Parameter::LidarYaw, "yaw, °", 180.0 / std::f64::consts::PI),
    (
        Parameter::SteeringOffset,
        "steering, °",
        180.0 / std::f64::consts::PI,
    ),
    (Parameter::SpeedScale, "speed scale, %", 1e2),
    (Parameter::Wheelbase, "wheelbase, mm", 1e3),
    (Parameter::TimeOffset, "delay, ms", 1e3),
    (Parameter::SteeringGain, "gain, %", 1e2),
];

/// A vehicle that differs from its configuration, and an estimator that knows which parameters are
/// uncertain.
struct Row {
    vehicle: &'static str,
    estimator: &'static str,
    robot: fn(u64) -> Robot,
    settings: fn() -> EstimatorSettings,
    /// Its claim: parameter, largest RMSE in its unit, in words.
    held: Option<(Parameter, f64)>,
}

const ROWS: [Row; 6] = [
    Row {
        vehicle: "wheelbase 1 % longer",
        estimator: "the paper's four only",
        robot: long,
        settings: four_only,
        held: None,
    },
    Row {
        vehicle: "wheelbase 1 % longer",
        estimator: "as usual: and speed scale, delay",
        robot: long,
        settings: EstimatorSettings::default,
        held: None,
    },
    Row {
        vehicle: "wheelbase 1 % longer",
        estimator: "and wheelbase",
        robot: long,
        settings: and_wheelbase,
        held: Some((Parameter::Wheelbase, 0.002)),
    },
    Row {
        vehicle: "steering gain 1.02",
        estimator: "as usual: and speed scale, delay",
        robot: geared,
        settings: EstimatorSettings::default,
        held: None,
    },
    Row {
        vehicle: "steering gain 1.02",
        estimator: "and gain",
        robot: geared,
        settings: and_gain,
        held: Some((Parameter::SteeringGain, 0.002)),
    },
    Row {
        vehicle: "steering gain 1.02",
        estimator: "and wheelbase instead",
        robot: geared,
        settings: and_wheelbase,
        held: None,
    },
];

/// Runs the study.
///
/// # Errors
/// The error of a run.
pub fn study(extent: &Extent) -> Result<Section, EvaluationError> {
    let mut section = Section::new("6c. Wheelbase, wheel radius, delay and gain refined together");
    section.words(format!(
        "A tugger whose wheels are 2 % larger than configured, whose wheel odometry is 60 ms late, and \
         whose wheelbase is 1 % longer or whose steering turns by 2 % more than it says. RMSE over the \
         seeds after {:.0} s from zero, raw scans; brackets: taken as configured, not estimated. \
         Wheelbase and gain are told apart by hardly any motion, so at most one of them is free: with \
         the wrong one free the vehicle drives the same, and the other four are right all the same.",
        extent.calibration_s
    ));
    let mut header = vec!["vehicle", "estimated"];
    header.extend(SHOWN.map(|(_, heading, _)| heading));
    header.push("NEES (4)");
    let mut table = Table::new(&header);
    for row in &ROWS {
        let runs = runs(&extent.seeds(), extent.calibration_s, |seed| {
            let mut robot = (row.robot)(seed);
            robot.calibrator.settings = (row.settings)();
            robot
        })?;
        table.row(cells(row, &runs)?);
        if let Some((parameter, bound)) = row.held {
            let what = format!("{} refined, RMSE", parameter.name().replace('_', " "));
            section.at_most(
                &what,
                rmse(parameter, &runs)?,
                bound,
                |value| match parameter.unit() {
                    Unit::Metre => format!("{:.2} mm", 1e3 * value),
                    _ => format!("{:.3} %", 1e2 * value),
                },
            );
        }
    }
    section.table(table);
    Ok(section)
}

fn wrong(seed: u64) -> Robot {
    let mut robot = tugger(seed, mount(0.43, 0.0046, 0.72), 0.92);
    robot.simulation.vehicle.speed_scale = 1.02;
    robot.simulation.vehicle.time_offset_s = 0.06;
    robot
}

fn long(seed: u64) -> Robot {
    let mut robot = wrong(seed);
    robot.simulation.vehicle.wheelbase_m *= 1.01;
    robot
}

fn geared(seed: u64) -> Robot {
    let mut robot = wrong(seed);
    robot.simulation.vehicle.steering_gain = 1.02;
    robot
}

fn four_only() -> EstimatorSettings {
    let mut settings = EstimatorSettings::default();
    settings.free.speed_scale = Freedom::Off;
    settings.free.wheelbase = Freedom::Off;
    settings.free.time_offset = Freedom::Off;
    settings
}

fn and_wheelbase() -> EstimatorSettings {
    let mut settings = EstimatorSettings::default();
    settings.free.wheelbase = Freedom::Estimated;
    settings.prior_sigma.wheelbase = 0.03;
    settings
}

fn and_gain() -> EstimatorSettings {
    let mut settings = EstimatorSettings::default();
    settings.free.steering_gain = Freedom::Estimated;
    settings.free.wheelbase = Freedom::Off;
    settings.prior_sigma.steering_gain = 0.03;
    settings
}

fn rmse(parameter: Parameter, runs: &[Driven]) -> Result<f64, EvaluationError> {
    let mut errors = Vec::new();
    for (seed, run) in (1..).zip(runs) {
        let (estimate, truth) = last("refinement", seed, run)?;
        errors.push(error_of(
            parameter,
            estimate.parameter(parameter).value,
            truth,
        ));
    }
    Ok(rms(&errors))
}

fn cells(row: &Row, runs: &[Driven]) -> Result<Vec<String>, EvaluationError> {
    let settings = (row.settings)();
    let mut cells = vec![row.vehicle.to_owned(), row.estimator.to_owned()];
    for (parameter, _, factor) in SHOWN {
        let shown = format!("{:.3}", factor * rmse(parameter, runs)?);
        cells.push(if settings.freedom(parameter) == Freedom::Estimated {
            shown
        } else {
            format!("({shown})")
        });
    }
    let nees: Vec<_> = runs
        .iter()
        .filter_map(|run| nees(&run.calibrator, &run.estimates.last()?.1))
        .collect();
    cells.push(format!("{:.1}", mean(&nees)));
    Ok(cells)
}
