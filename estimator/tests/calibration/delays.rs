//! Delay of a detected change. The whole table: `cargo run --release -p fleetcal-estimator --example
//! estimator_figures -- delays`.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::estimate::Cause;
use fleetcal_robot::simulator::{Change, Pose2, ScheduledChange, SimulationConfig};

use crate::changed::{CHANGE_S, changed, found};
use crate::drive::{drive, poses, vehicle_of};

/// Asserts that the change is found within so many seconds on every seed, once, and by its cause.
fn assert_found(change: Change, cause: Cause, delay_max_s: f64) {
    for seed in 1..=4 {
        let run = changed(seed, change, Some(poses()), 62.0 + delay_max_s);
        assert!(!run.changes.is_empty(), "seed {seed}, {change:?}: not seen");
        let found = found(&run).unwrap();
        println!(
            "seed {seed}, {change:?}: {:.1} s, {:.1} m",
            found.delay_s, found.delay_m
        );
        assert_eq!(found.cause, cause, "seed {seed}, {change:?}");
        assert_eq!(
            found.events, 1,
            "seed {seed}, {change:?}: {:?}",
            run.changes
        );
        assert!(
            (0.0..=delay_max_s).contains(&found.delay_s),
            "seed {seed}, {change:?}: after {} s",
            found.delay_s
        );
    }
}

fn steering(deg: f64) -> Change {
    Change::SteeringOffset(deg.to_radians())
}

fn mount(x_m: f64, yaw_deg: f64) -> Change {
    Change::Mount(Pose2::new(x_m, 0.0, yaw_deg.to_radians()))
}

#[test]
fn a_steering_zero_that_moves_is_seen_the_sooner_the_farther() {
    assert_found(steering(2.0), Cause::Steering, 4.0);
    assert_found(steering(0.5), Cause::Steering, 10.0);
    assert_found(steering(0.25), Cause::Steering, 40.0);
}

#[test]
fn a_lidar_that_moves_is_seen_the_sooner_the_farther() {
    assert_found(mount(0.0, 1.0), Cause::LidarMount, 8.0);
    assert_found(mount(0.03, 0.0), Cause::LidarMount, 15.0);
}

/// Asserts that a drift by a tenth of a degree an hour is found: no window shows it.
fn assert_drift_found(change: Change, cause: Cause) {
    let mut config = SimulationConfig::figure_eight(3);
    config.lidar = poses();
    config.changes = vec![ScheduledChange {
        at_s: CHANGE_S,
        change,
    }];
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, config.vehicle.wheelbase_m));
    let run = drive(config, calibrator, CHANGE_S + 4500.0);
    assert!(!run.changes.is_empty(), "{change:?}: not seen");
    for flagged in &run.changes {
        println!("{change:?}: {:.0} s, {:?}", flagged.time_s, flagged.change);
        assert_eq!(flagged.cause, cause, "{change:?}");
        let (_, moved) = flagged.change.first().unwrap();
        assert!(moved.abs() < 0.125f64.to_radians(), "{flagged:?}");
    }
}

#[test]
fn a_drift_of_a_tenth_of_a_degree_an_hour_is_seen() {
    let per_s = 0.1f64.to_radians() / 3600.0;
    assert_drift_found(Change::SteeringDrift(per_s), Cause::Steering);
    assert_drift_found(Change::MountYawDrift(per_s), Cause::LidarMount);
}
