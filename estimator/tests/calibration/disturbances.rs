//! Disturbances that no calibration explains are flagged, and no wrong number is called converged.

use fleetcal_estimator::estimate::{Cause, ChangeKind};
use fleetcal_estimator::{Parameter, Status};

use crate::disturbed::{BEGIN_S, Disturbance, disturbed};
use crate::drive::{Driven, error_of};

fn assert_honest(run: &Driven, name: &str) {
    for (estimate, truth) in &run.estimates {
        for parameter in Parameter::ALL {
            let found = estimate.parameter(parameter);
            let error = error_of(parameter, estimate, truth);
            assert!(
                found.status != Status::Converged || error.abs() <= 4.0 * found.sigma,
                "{name} at {} s: {} is off by {error}, sigma {}",
                estimate.time_s,
                parameter.name(),
                found.sigma
            );
        }
    }
}

/// Asserts that it is flagged once, as a fault, and that afterwards the calibration is as good as
/// before.
fn assert_fault(disturbance: Disturbance, cause: Cause, delay_max_s: f64) {
    for seed in 1..=3 {
        let name = format!("{disturbance:?}, seed {seed}");
        let run = disturbed(disturbance, seed);
        assert_honest(&run, &name);
        assert_eq!(run.changes.len(), 1, "{name}: {:?}", run.changes);
        let fault = &run.changes[0];
        assert_eq!(
            (fault.kind, fault.cause),
            (ChangeKind::Fault, cause),
            "{name}"
        );
        let delay_s = fault.time_s - BEGIN_S;
        assert!(
            (0.0..=delay_max_s).contains(&delay_s),
            "{name}: {delay_s} s"
        );
        for parameter in &run.last().0.parameters[..4] {
            assert_eq!(parameter.status, Status::Converged, "{name}");
        }
    }
}

#[test]
fn a_stuck_steering_sensor_is_a_fault_and_teaches_nothing() {
    assert_fault(Disturbance::StuckSteering, Cause::Steering, 4.0);
}

#[test]
fn a_pushed_robot_is_a_fault_and_teaches_nothing() {
    assert_fault(Disturbance::Pushed, Cause::Vehicle, 2.0);
}

#[test]
fn lifted_wheels_are_a_fault_and_teach_nothing() {
    assert_fault(Disturbance::WheelLift, Cause::Unknown, 2.0);
}

#[test]
fn a_fast_car_that_slips_is_known_no_better_than_it_is() {
    // Of the first 240 the last five have the slip that looked most like something else.
    for seed in (1..=8).chain([73, 122, 128, 130, 238]) {
        let run = disturbed(Disturbance::SlippingCar, seed);
        assert!(run.changes.is_empty(), "seed {seed}: {:?}", run.changes);
        assert_honest(&run, &format!("slipping car, seed {seed}"));
    }
}

#[test]
fn turning_to_one_side_only_tells_what_it_can() {
    for seed in 1..=4 {
        let circle = disturbed(Disturbance::OneSided, seed);
        assert_honest(&circle, "one circle after the other");
        for parameter in [Parameter::LidarX, Parameter::LidarY] {
            let status = circle.last().0.parameter(parameter).status;
            assert_ne!(status, Status::Converged, "{}", parameter.name());
        }
        let turns = disturbed(Disturbance::LeftLoop, seed);
        assert_honest(&turns, "straights and left turns");
        assert!(turns.changes.is_empty(), "{:?}", turns.changes);
    }
}
