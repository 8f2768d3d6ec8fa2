//! Simulated robots on which one value changes, early or late, or none.

use std::ops::ControlFlow;

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::{Vehicle, VehicleModel};
use fleetcal_robot::simulator::{
    Change, Imperfections, LidarOutput, Pose2, PoseSettings, ScheduledChange, SimulationConfig,
    VehicleModel as TrueModel,
};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

use super::Outcome;
use crate::drive::{Robot, Seen, drive_watched, error_of};
use crate::error::EvaluationError;
use crate::imperfect::Road;

/// Time of a drive after its change, s.
const AFTER_S: f64 = 90.0;

/// Sizes of changes: angles, rad, and distances, m.
const ANGLES_DEG: [f64; 3] = [0.5, 1.5, 5.0];
const YAWS_DEG: [f64; 3] = [0.5, 1.0, 3.0];
const X_M: f64 = 0.04;
const Y_M: f64 = 0.03;

/// Drives the robot of a seed, with its change or without; returns its name and outcome. Every third is a
/// tricycle, every fourth is clean, and all others have all typical imperfections.
///
/// # Errors
/// Names the setting or message that is refused.
pub fn drive(seed: u64, is_changed: bool) -> Result<(String, Outcome), EvaluationError> {
    let (robot, at_s, name) = robot(seed, is_changed);
    let mut outcome = Outcome::default();
    let mut flags = 0;
    drive_watched(robot, at_s + AFTER_S, |time_s, seen, robot| {
        if let Seen::Estimate(estimate, calibrator) = seen {
            let truth = robot.parameters();
            let error = |p| error_of(p, estimate.parameter(p).value, &truth);
            outcome.see(estimate, error, is_changed && time_s >= at_s);
            let changes = calibrator.changes();
            for change in changes.iter().skip(flags) {
                outcome.flag(change, estimate.distance_m);
            }
            flags = changes.len();
        }
        ControlFlow::Continue(())
    })?;
    Ok((name, outcome))
}

/// The robot of a seed, with the time of its change, s, and its name.
fn robot(seed: u64, is_changed: bool) -> (Robot, f64, String) {
    let mut random = StdRng::seed_from_u64(seed);
    let mut simulation = SimulationConfig::figure_eight(seed);
    let mut around = |half: f64| random.random_range(-half..half);
    let is_tricycle = seed.is_multiple_of(3);
    let (model, known) = if is_tricycle {
        (TrueModel::Tricycle, VehicleModel::Tricycle)
    } else {
        (TrueModel::Bicycle, VehicleModel::Bicycle)
    };
    simulation.vehicle.model = model;
    simulation.vehicle.steering_offset_rad = around(3f64.to_radians());
    simulation.vehicle.lidar_in_base = Pose2::new(0.434 + around(0.05), around(0.05), around(0.05));
    simulation.vehicle.speed_scale = 1.0 + around(0.01);
    simulation.vehicle.time_offset_s = around(0.03);
    let is_clean = seed.is_multiple_of(4);
    if !is_clean {
        simulation.imperfections = Imperfections::all_typical(seed, false);
    }
    let road = Road::ALL[random.random_range(0..3)];
    simulation.route = road.route();
    simulation.people.count = 0;
    simulation.lidar = LidarOutput::Poses(PoseSettings {
        position_sigma_m: 0.003,
        yaw_sigma_rad: 5e-4,
        ..PoseSettings::default()
    });
    let (kind, change) = change(&mut random);
    let is_early = random.random();
    let at_s = if is_early {
        random.random_range(10.0..25.0)
    } else {
        random.random_range(70.0..130.0)
    };
    if is_changed {
        simulation.changes = vec![ScheduledChange { at_s, change }];
    }
    let name = format!(
        "{seed} {} {} {} {kind} at {at_s:.0} s",
        if is_tricycle { "tricycle" } else { "bicycle" },
        if is_clean { "clean" } else { "typical" },
        road.name(),
    );
    let known = Vehicle::new(known, simulation.configured_wheelbase_m());
    let robot = Robot {
        calibrator: CalibratorConfig::of(known),
        simulation,
        heard_from_s: 0.0,
    };
    (robot, at_s, name)
}

/// A change of the steering or the mount, and its name.
fn change(random: &mut StdRng) -> (String, Change) {
    let sign = if random.random() { 1.0 } else { -1.0 };
    match random.random_range(0..8) {
        i @ 0..3 => {
            let deg = sign * ANGLES_DEG[i];
            let change = Change::SteeringOffset(deg.to_radians());
            (format!("steering {deg} deg"), change)
        }
        i @ 3..6 => {
            let deg = sign * YAWS_DEG[i - 3];
            let turn = Pose2::new(0.0, 0.0, deg.to_radians());
            (format!("yaw {deg} deg"), Change::Mount(turn))
        }
        6 => {
            let moved = Pose2::new(sign * X_M, 0.0, 0.0);
            (format!("x {} m", moved.x_m), Change::Mount(moved))
        }
        _ => {
            let moved = Pose2::new(0.0, sign * Y_M, 0.0);
            (format!("y {} m", moved.y_m), Change::Mount(moved))
        }
    }
}
