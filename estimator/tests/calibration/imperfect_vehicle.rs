//! Vehicles whose steering curve is not a straight line: they converge, and a change on them is flagged.

use fleetcal_estimator::Status;
use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::estimate::Cause;
use fleetcal_robot::simulator::{
    Change, ImperfectionKind, Imperfections, Point, Pose2, Route, ScheduledChange, SimulationConfig,
};

use crate::drive::{Driven, FOUR, drive, error_of, poses, vehicle_of};

/// Time of the change, s.
const CHANGE_S: f64 = 90.0;
/// Way after which a change of half a degree is flagged, m.
const FLAGGED_AFTER_M: f64 = 20.0;
/// Errors after three minutes: x, y (m), and both angles (rad), in the order of [`FOUR`].
const BOUNDS: [f64; 4] = [3.5e-4, 0.003, 0.005, 5.2e-4];

fn aisles(kind: ImperfectionKind, seed: u64, change: Option<Change>, duration_s: f64) -> Driven {
    drive_on(
        Route::aisles_with_reversals(),
        kind,
        seed,
        change,
        duration_s,
    )
}

fn drive_on(
    route: Route,
    kind: ImperfectionKind,
    seed: u64,
    change: Option<Change>,
    duration_s: f64,
) -> Driven {
    let mut config = SimulationConfig::figure_eight(seed);
    config.route = route;
    config.lidar = poses();
    config.people.count = 0;
    config.vehicle.steering_offset_rad = 0.03;
    config.vehicle.time_offset_s = 0.02;
    config.imperfections =
        Imperfections::single(kind, if seed.is_multiple_of(2) { 1.0 } else { -1.0 });
    config.changes.extend(change.map(|change| ScheduledChange {
        at_s: CHANGE_S,
        change,
    }));
    let known_m = config.configured_wheelbase_m();
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, known_m));
    drive(config, calibrator, duration_s)
}

/// Three minutes of aisles, with one typical imperfection of the steering: nine of ten robots converge.
#[test]
fn a_robot_with_another_steering_converges_and_is_true() {
    let mut all = 0;
    for kind in [
        ImperfectionKind::SteeringGain,
        ImperfectionKind::Wheelbase,
        ImperfectionKind::SteeringAsymmetry,
        ImperfectionKind::Backlash,
        ImperfectionKind::SteeringLag,
        ImperfectionKind::SteeringDelay,
    ] {
        let converged = (1..=10).filter(|seed| {
            let run = aisles(kind, *seed, None, 180.0);
            assert!(run.changes.is_empty(), "{kind:?}: {:?}", run.changes);
            let (estimate, truth) = run.last();
            let mut all_converged = true;
            for (parameter, bound) in FOUR.into_iter().zip(BOUNDS) {
                let found = estimate.parameter(parameter);
                let error = error_of(parameter, estimate, truth).abs();
                assert!(error < bound, "{kind:?}, {seed}: {found:?} off by {error}");
                all_converged &= found.status == Status::Converged;
            }
            all_converged
        });
        let converged = converged.count();
        println!("{kind:?}: {converged} of 10");
        assert!(converged >= 9, "{kind:?}: {converged} of 10");
        all += converged;
    }
    assert!(all >= 57, "{all} of 60");
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

/// Asserts that nothing four sigmas off is claimed once the change had its 20 m, whether it was
/// flagged or not.
fn assert_true_claims(run: &Driven, name: &str) {
    let changed_m = run.at(CHANGE_S).0.distance_m;
    for (estimate, truth) in &run.estimates {
        if estimate.time_s >= CHANGE_S && estimate.distance_m < changed_m + FLAGGED_AFTER_M {
            continue;
        }
        for parameter in FOUR {
            let found = estimate.parameter(parameter);
            let error = error_of(parameter, estimate, truth).abs();
            assert!(
                found.status != Status::Converged || error <= 4.0 * found.sigma,
                "{name} at {} s: off by {error}, {found:?}",
                estimate.time_s
            );
        }
    }
}

#[test]
fn a_steering_zero_that_jumps_on_a_robot_with_another_gain_is_flagged_and_nothing_false_is_claimed()
{
    let jump = Change::SteeringOffset(1.5f64.to_radians());
    for (route_name, route) in [
        ("eight", Route::staging_figure_eight()),
        ("aisles", Route::aisles_with_reversals()),
        ("left", Route::left_loop(Point::new(-11.0, 0.0), 10.0, 8.0)),
    ] {
        for seed in 1..=4 {
            let kind = ImperfectionKind::SteeringGain;
            let run = drive_on(route.clone(), kind, seed, Some(jump), CHANGE_S + 60.0);
            let name = format!("{route_name}, seed {seed}: {:?}", run.changes);
            let causes: Vec<_> = run.changes.iter().map(|change| change.cause).collect();
            assert_eq!(causes, [Cause::Steering], "{name}");
            let flagged_s = run.changes.first().map_or(f64::INFINITY, |c| c.time_s);
            let way_m = |time_s: f64| run.at(time_s).0.distance_m;
            let after_m = way_m(flagged_s) - way_m(CHANGE_S);
            println!("{route_name}, seed {seed}: {after_m:.1} m");
            assert!((0.0..FLAGGED_AFTER_M).contains(&after_m), "{name}");
            assert_true_claims(&run, &name);
        }
    }
}
