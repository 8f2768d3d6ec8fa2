//! Takeovers of a robot by another process from its last checkpoint: a minute later it is as
//! certain as one that was never interrupted.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::{Calibrator, Checkpoint, Event};
use fleetcal_robot::simulator::{
    LidarOutput, LidarSettings, Point, Route, Simulation, SimulationConfig,
};

use crate::drawn::drawn;
use crate::drive::{FOUR, event_of, vehicle_of};

/// Time of the checkpoint that a robot is taken over from, s.
const CHECKPOINT_S: f64 = 180.0;
/// Time from then on in which no message arrives, until a takeover is over: the checkpoint of a
/// cluster's robot is up to a twentieth of its session old, and a takeover takes up to 3 s.
const LOST_S: f64 = 12.0;
/// Time for which the robot drives from then on, s.
const DRIVEN_S: f64 = 60.0;
const SEEDS: u64 = 12;
/// Robots on loops with their turns mostly to one side.
const ONE_SIDED_SEEDS: u64 = 12;
/// Share by which a sigma may be larger than that of the undisturbed estimator.
const LESS_CERTAIN: f64 = 0.05;

/// A robot without an imperfection that sends scans.
fn robot(seed: u64) -> SimulationConfig {
    let mut config = SimulationConfig::figure_eight(seed);
    config.lidar = LidarOutput::Scans(LidarSettings::default());
    config.route = match seed % 3 {
        0 => Route::staging_figure_eight(),
        1 => Route::aisle_loop(),
        _ => Route::figure_eight(Point::new(-11.0, 1.0), -5.0, 1.7),
    };
    config.speed.period_s = 17.0 + seed as f64;
    config.vehicle = drawn(seed).0.vehicle;
    config.vehicle.wheelbase_m = 1.2;
    config.vehicle.slip.lateral_rad_per_mps2 = 0.0;
    config
}

fn messages(config: &SimulationConfig, duration_s: f64) -> Vec<(f64, Event)> {
    let start_ns = config.start_stamp_ns;
    let mut simulation = Simulation::new(config.clone()).unwrap();
    std::iter::from_fn(|| Some(simulation.advance()))
        .map(|emitted| ((emitted.sent_ns - start_ns) as f64 * 1e-9, emitted.message))
        .take_while(|(time_s, _)| *time_s <= duration_s)
        .filter_map(|(time_s, message)| Some((time_s, event_of(message)?)))
        .collect()
}

/// A calibrator that was fed with the messages of a time (s).
fn fed(
    mut calibrator: Calibrator,
    messages: &[(f64, Event)],
    time_s: std::ops::Range<f64>,
) -> Calibrator {
    for (_, event) in messages.iter().filter(|(at_s, _)| time_s.contains(at_s)) {
        calibrator.step(event.clone());
    }
    calibrator
}

fn sigmas(calibrator: &Calibrator) -> [f64; 4] {
    let estimate = calibrator.estimate();
    FOUR.map(|parameter| estimate.parameter(parameter).sigma)
}

/// Shares by which the sigmas of the four are larger than undisturbed, where so many seconds of
/// messages are lost.
fn certainty_lost(seed: u64, lost_s: f64) -> [f64; 4] {
    let robot = robot(seed);
    let config = CalibratorConfig::of(vehicle_of(&robot.vehicle, robot.vehicle.wheelbase_m));
    let from_s = CHECKPOINT_S + lost_s;
    let to_s = from_s + DRIVEN_S;
    let messages = messages(&robot, to_s);
    let calibrator = Calibrator::new(config.clone());
    let before = fed(calibrator, &messages, 0.0..CHECKPOINT_S);
    let stored = serde_json::to_string(&before.checkpoint()).unwrap();
    let read: Checkpoint = serde_json::from_str(&stored).unwrap();
    let undisturbed = sigmas(&fed(before, &messages, CHECKPOINT_S..to_s));
    let restored = Calibrator::restore(config, &read).unwrap();
    let restored = sigmas(&fed(restored, &messages, from_s..to_s));
    std::array::from_fn(|i| restored[i] / undisturbed[i] - 1.0)
}

#[test]
fn a_minute_after_a_takeover_nearly_nothing_is_less_certain() {
    for seed in 1..=SEEDS {
        let lost = certainty_lost(seed, LOST_S);
        println!("seed {seed}: {lost:+.3?}");
        for (parameter, lost) in FOUR.into_iter().zip(lost) {
            assert!(lost <= LESS_CERTAIN, "{parameter:?}: {lost}");
        }
    }
}

/// Sigma of `y` includes the possible effect of an encoder beside the axle, by the curve of the
/// steering: on a loop with its turns mostly to one side that must not be the error of the curve's
/// estimate, which changes with each new local map.
#[test]
fn a_restart_that_loses_no_message_leaves_y_as_certain_on_loops_to_one_side() {
    for number in 0..ONE_SIDED_SEEDS {
        // Every third robot drives around the aisles.
        let seed = 3 * number + 1;
        let lost = certainty_lost(seed, 0.0);
        println!("seed {seed}: {lost:+.3?}");
        for (parameter, lost) in FOUR.into_iter().zip(lost) {
            assert!(lost.abs() <= LESS_CERTAIN, "{parameter:?}, {seed}: {lost}");
        }
    }
}
