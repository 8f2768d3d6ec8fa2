//! The rest of study 6d: the advisor's first choice with the whole estimator, on raw scans.

use std::ops::ControlFlow;

use fleetcal_estimator::advice::manoeuvre::{Manoeuvre, library};
use fleetcal_estimator::geometry::Pose2;
use fleetcal_estimator::vehicle::{DriveParameters, SteeringCurve, SteeringResponse, Vehicle};
use fleetcal_estimator::{Parameter, Status};
use fleetcal_robot::simulator::{Point, Route, SpeedProfile};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::cases::last;
use crate::drive::{FOUR, Robot, Seen, drive_watched, error_of};
use crate::error::EvaluationError;
use crate::extent::Extent;
use crate::report::{Section, Table};
use crate::robots::{mount, tugger};
use crate::statistics::{mean, rms};

const STUDY: &str = "first choice";
/// Start of the robot: in an aisle, looking to the staging area.
const START: Pose2 = Pose2::new(8.0, -2.0, std::f64::consts::PI);
/// Straight distance before the advisor is queried, m.
const AISLE_M: f64 = 14.0;
/// Distance after the manoeuvre, m.
const TAIL_M: f64 = 0.5;
/// Time in which any of the drives has ended, s.
const LONG_ENOUGH_S: f64 = 120.0;
/// Manoeuvres that a route forward describes and that fit there.
const DRIVEN: [&str; 6] = [
    "straight",
    "left_turn",
    "right_turn",
    "left_circle",
    "s_curve",
    "figure_eight",
];

/// Outcome of one drive.
struct Ended {
    /// Errors and claimed sigmas of the four, SI.
    errors: [f64; 4],
    sigmas: [f64; 4],
    converged: usize,
    /// Advised manoeuvres after the aisle, best first.
    advised: Vec<&'static str>,
}

/// Adds the table.
///
/// # Errors
/// The error of a run.
pub fn add(extent: &Extent, section: &mut Section) -> Result<(), EvaluationError> {
    let vehicle = tugger(1, mount(0.43, 0.0046, 0.72), 0.92)
        .calibrator
        .vehicle;
    let (mut table, mut first) = (
        Table::new(&[
            "after the aisle",
            "way, m",
            "x, mm",
            "y, mm",
            "yaw, °",
            "steering, °",
            "converged of 4",
        ]),
        "",
    );
    for manoeuvre in library(&vehicle) {
        if !DRIVEN.contains(&manoeuvre.name) {
            continue;
        }
        let each = |&seed: &u64| one_drive(&manoeuvre, &vehicle, seed);
        let all: Result<Vec<_>, EvaluationError> = extent.seeds().par_iter().map(each).collect();
        let all = all?;
        first = first_choice(&all).unwrap_or(first);
        table.row(cells(&manoeuvre, &all));
    }
    section.words(format!(
        "With the whole estimator: a tugger of whose mount nothing is known drives {AISLE_M} m out of \
         an aisle, with raw scans and people, asks its estimator, which says **{first}**, and drives \
         one manoeuvre in the staging area. RMSE, and behind the stroke the sigma that it claims. One \
         manoeuvre does not always make all four `converged`: the last column is the mean count."
    ));
    section.table(table);
    Ok(())
}

fn one_drive(
    manoeuvre: &Manoeuvre,
    vehicle: &Vehicle,
    seed: u64,
) -> Result<Ended, EvaluationError> {
    let mut robot: Robot = tugger(seed, mount(0.43, 0.0046, 0.72), 0.92);
    let points = points(manoeuvre, vehicle);
    let route = Route::from_points(&points, false);
    let way_m = route.length_m() - 0.2;
    robot.simulation.route = route;
    robot.simulation.applied.lidar_in_base = robot.simulation.vehicle.lidar_in_base;
    robot.simulation.applied.steering_offset_rad = robot.simulation.vehicle.steering_offset_rad;
    robot.simulation.speed = SpeedProfile {
        min_mps: 0.8,
        max_mps: 0.8,
        ..robot.simulation.speed
    };
    let mut advised = Vec::new();
    let run = drive_watched(robot, LONG_ENOUGH_S, |_, seen, _| {
        let Seen::Estimate(estimate, calibrator) = seen else {
            return ControlFlow::Continue(());
        };
        if estimate.distance_m >= AISLE_M && advised.is_empty() {
            let ranked = calibrator.next_manoeuvres(None);
            advised.extend(ranked.iter().map(|ranked| ranked.advice.manoeuvre.name));
        }
        if estimate.distance_m >= way_m {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    })?;
    let (estimate, truth) = last(STUDY, seed, &run)?;
    let found = FOUR.map(|parameter| estimate.parameter(parameter));
    Ok(Ended {
        errors: FOUR.map(|p: Parameter| error_of(p, estimate.parameter(p).value, truth)),
        sigmas: found.map(|found| found.sigma),
        converged: found
            .iter()
            .filter(|found| found.status == Status::Converged)
            .count(),
        advised,
    })
}

/// Returns the way: the aisle, the manoeuvre, a little further.
fn points(manoeuvre: &Manoeuvre, vehicle: &Vehicle) -> Vec<Point> {
    let parameters = DriveParameters {
        steering_offset_rad: 0.0,
        speed_scale: 1.0,
        wheelbase_m: vehicle.wheelbase_m,
        steering_gain: 1.0,
        side_slip_rad_per_mps2: 0.0,
        curve: SteeringCurve::default(),
        response: SteeringResponse::default(),
        half_play_rad: 0.0,
    };
    let mut pose = START;
    let mut points = vec![Point::new(pose.x_m, pose.y_m)];
    pose = pose.compose(&Pose2::new(AISLE_M, 0.0, 0.0));
    points.push(Point::new(pose.x_m, pose.y_m));
    for reading in manoeuvre.readings(vehicle) {
        let motion = vehicle.motion(reading.drive, &parameters);
        let twist = Vector3::new(motion.speed_mps, 0.0, motion.yaw_rate_radps);
        pose = pose.compose(&Pose2::exp(&(twist * reading.duration_s)));
        points.push(Point::new(pose.x_m, pose.y_m));
    }
    pose = pose.compose(&Pose2::new(TAIL_M, 0.0, 0.0));
    points.push(Point::new(pose.x_m, pose.y_m));
    points
}

/// Returns the first choice of the first robot that queried the advisor.
fn first_choice(all: &[Ended]) -> Option<&'static str> {
    all.first()?.advised.first().copied()
}

fn cells(manoeuvre: &Manoeuvre, all: &[Ended]) -> Vec<String> {
    let factors = [1e3, 1e3, 1.0_f64.to_degrees(), 1.0_f64.to_degrees()];
    let mut cells = vec![
        manoeuvre.name.to_owned(),
        format!("{:.0}", manoeuvre.distance_m()),
    ];
    for (i, factor) in factors.into_iter().enumerate() {
        let errors: Vec<_> = all.iter().map(|ended| factor * ended.errors[i]).collect();
        let sigmas: Vec<_> = all.iter().map(|ended| factor * ended.sigmas[i]).collect();
        cells.push(format!("{:.3} / {:.3}", rms(&errors), mean(&sigmas)));
    }
    cells.push(format!("{:.1}", mean_converged(all)));
    cells
}

fn mean_converged(all: &[Ended]) -> f64 {
    let converged: Vec<_> = all.iter().map(|ended| ended.converged as f64).collect();
    mean(&converged)
}
