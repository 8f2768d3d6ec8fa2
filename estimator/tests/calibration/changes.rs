//! Changes in mid-run: flagged soon, with the right cause, once, and right again afterwards.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::estimate::Cause;
use fleetcal_estimator::{Estimate, Parameter};
use fleetcal_robot::simulator::{Change, Pose2, ScheduledChange, SimulationConfig, TrueParameters};

use crate::drive::{Driven, FOUR, drive, error_of, vehicle_of};

const CHANGE_S: f64 = 60.0;

fn with_change(seed: u64, change: Option<Change>, duration_s: f64) -> Driven {
    let mut config = SimulationConfig::figure_eight(seed);
    config.vehicle.steering_offset_rad = 0.03;
    config.vehicle.lidar_in_base = Pose2::new(0.434, 0.0046, 0.72f64.to_radians());
    config.applied.lidar_in_base = config.vehicle.lidar_in_base;
    config.changes = change
        .map(|change| ScheduledChange {
            at_s: CHANGE_S,
            change,
        })
        .into_iter()
        .collect();
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, config.vehicle.wheelbase_m));
    drive(config, calibrator, duration_s)
}

/// Asserts that the change is flagged once, with its cause, within the delay; half a minute later
/// inside four sigma for every seed, and inside the limits; its amount published within a minute.
fn check(change: Change, cause: Cause, amounts: &[f64], delay_max_s: f64) {
    let mut outside = Vec::new();
    for seed in 1..=8 {
        let flagged_s = CHANGE_S + delay_max_s;
        let run = with_change(seed, Some(change), flagged_s + 60.0);
        assert_eq!(
            run.changes.len(),
            1,
            "seed {seed}, {change:?}: {:?}",
            run.changes
        );
        let flagged = &run.changes[0];
        assert_eq!(flagged.cause, cause, "seed {seed}, {change:?}");
        let delay_s = flagged.time_s - CHANGE_S;
        println!(
            "seed {seed}, {cause:?}: flagged after {delay_s:.1} s, onset {:.1}",
            flagged.onset_s
        );
        assert!(
            delay_s <= delay_max_s,
            "seed {seed}, {change:?}: flagged after {delay_s} s"
        );
        assert!(
            (flagged.onset_s - CHANGE_S).abs() <= 3.0,
            "onset {}",
            flagged.onset_s
        );
        assert_amount(&run, amounts, seed);
        if !is_right(run.at(flagged_s + 30.0), seed) {
            outside.push(seed);
        }
    }
    assert!(outside.is_empty(), "outside the limits: seeds {outside:?}");
}

/// Asserts that the amount is published with the flag, or once and under the same stamp as soon as
/// it is known.
fn assert_amount(run: &Driven, amounts: &[f64], seed: u64) {
    let flagged = &run.changes[0];
    let again = run.sized.len();
    assert!(again <= 1, "seed {seed}: told again {again} times");
    let told = run.sized.first().unwrap_or(flagged);
    assert_eq!((told.stamp, told.cause), (flagged.stamp, flagged.cause));
    assert!(
        again == 0 || flagged.change.is_empty(),
        "seed {seed}: {flagged:?}"
    );
    assert_eq!(told.change.len(), amounts.len(), "seed {seed}: {told:?}");
    for ((_, moved), by) in told.change.iter().zip(amounts) {
        assert!((moved - by).abs() < 0.01, "seed {seed}: {told:?}");
    }
}

fn is_right((estimate, truth): &(Estimate, TrueParameters), seed: u64) -> bool {
    let limits = [0.02f64.to_radians(), 0.002, 0.002, 0.03f64.to_radians()];
    FOUR.into_iter().zip(limits).all(|(parameter, limit)| {
        let error = error_of(parameter, estimate, truth);
        let sigma = estimate.parameter(parameter).sigma;
        let name = parameter.name();
        assert!(
            error.abs() <= 4.0 * sigma,
            "seed {seed}: {name} is off by {error}, sigma {sigma}"
        );
        println!("  {name} {:.2} of its limit", error.abs() / limit);
        error.abs() <= limit
    })
}

#[test]
fn a_jump_of_the_steering_zero_is_flagged_as_steering() {
    check(
        Change::SteeringOffset(1.5f64.to_radians()),
        Cause::Steering,
        &[1.5f64.to_radians()],
        3.0,
    );
}

#[test]
fn a_knocked_lidar_is_flagged_as_lidar_mount() {
    let knock = Pose2::new(0.03, 0.0, -1.5f64.to_radians());
    check(
        Change::Mount(knock),
        Cause::LidarMount,
        &[knock.x_m, knock.y_m, knock.yaw_rad],
        3.0,
    );
}

#[test]
fn nothing_is_flagged_while_nothing_changes() {
    for seed in 1..=6 {
        let run = with_change(seed, None, 180.0);
        assert!(run.changes.is_empty(), "seed {seed}: {:?}", run.changes);
    }
}

#[test]
fn segments_tell_the_vehicle_before_from_the_one_after() {
    let run = with_change(3, Some(Change::SteeringOffset(0.03)), 100.0);
    let segments = run.calibrator.segments();
    assert_eq!(segments.len(), 2, "{:?}", run.changes);
    let offsets: Vec<_> = segments
        .iter()
        .map(|s| s.parameters[Parameter::SteeringOffset.index()].value)
        .collect();
    assert!(
        (offsets[0] - 0.03).abs() < 1e-3 && (offsets[1] - 0.06).abs() < 1e-3,
        "{offsets:?}"
    );
}
