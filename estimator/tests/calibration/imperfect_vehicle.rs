//! Vehicles whose steering curve is not a straight line: they converge, and a change on them is flagged.

use fleetcal_estimator::Status;
use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::estimate::Cause;
use fleetcal_robot::simulator::{
    Change, ImperfectionKind, Imperfections, Pose2, Route, ScheduledChange, SimulationConfig,
};

use crate::drive::{Driven, FOUR, drive, error_of, poses, vehicle_of};

/// When something changes, s.
const CHANGE_S: f64 = 90.0;
/// How far a robot has driven when a change of half a degree is flagged, m.
const FLAGGED_AFTER_M: f64 = 20.0;
/// Errors after three minutes: x, y (m), and both angles (rad), in the order of [`FOUR`].
const BOUNDS: [f64; 4] = [3.5e-4, 0.003, 0.005, 5.2e-4];

fn aisles(kind: ImperfectionKind, seed: u64, change: Option<Change>, duration_s: f64) -> Driven {
    let mut config = SimulationConfig::figure_eight(seed);
    config.route = Route::aisles_with_reversals();
    config.lidar = poses();
    config.people.count = 0;
    config.vehicle.steering_offset_rad = 0.03;
    config.vehicle.time_offset_s = 0.02;
    config.imperfections = Imperfections::single(kind, if seed % 2 == 0 { 1.0 } else { -1.0 });
    config.changes.extend(change.map(|change| ScheduledChange {
        at_s: CHANGE_S,
        change,
    }));
    let known_m = config.configured_wheelbase_m();
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, known_m));
    drive(config, calibrator, duration_s)
}

#[test]
fn a_robot_with_another_steering_curve_converges_and_is_true() {
    for kind in [
        ImperfectionKind::SteeringGain,
        ImperfectionKind::Wheelbase,
        ImperfectionKind::SteeringAsymmetry,
    ] {
        for seed in 1..=4 {
            let run = aisles(kind, seed, None, 180.0);
            assert!(run.changes.is_empty(), "{kind:?}: {:?}", run.changes);
            let (estimate, truth) = run.last();
            for (parameter, bound) in FOUR.into_iter().zip(BOUNDS) {
                let found = estimate.parameter(parameter);
                let error = error_of(parameter, estimate, truth).abs();
                let name = format!("{kind:?}, seed {seed}: {found:?}");
                assert_eq!(found.status, Status::Converged, "{name}");
                assert!(error < bound, "{name} is off by {error}");
            }
        }
    }
}

#[test]
fn a_change_on_a_robot_with_another_steering_curve_is_flagged_as_what_it_is() {
    let half_rad = 0.5f64.to_radians();
    let turned = Change::Mount(Pose2::new(0.0, 0.0, half_rad));
    for (change, cause) in [
        (Change::SteeringOffset(half_rad), Cause::Steering),
        (turned, Cause::LidarMount),
    ] {
        for kind in [
            ImperfectionKind::SteeringGain,
            ImperfectionKind::SteeringAsymmetry,
        ] {
            for seed in 1..=3 {
                let run = aisles(kind, seed, Some(change), CHANGE_S + 40.0);
                let name = format!("{kind:?}, {change:?}, seed {seed}: {:?}", run.changes);
                assert_eq!(run.changes.len(), 1, "{name}");
                let [flagged, ..] = &run.changes[..] else {
                    return;
                };
                assert_eq!(flagged.cause, cause, "{name}");
                let way_m = |time_s: f64| run.at(time_s).0.distance_m;
                let after_m = way_m(flagged.time_s) - way_m(CHANGE_S);
                println!("{kind:?}, {change:?}, seed {seed}: {after_m:.1} m");
                assert!((0.0..FLAGGED_AFTER_M).contains(&after_m), "{name}");
            }
        }
    }
}
