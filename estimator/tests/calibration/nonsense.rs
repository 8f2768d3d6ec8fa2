//! Input that no vehicle sends, or of which most is refused: nothing is converged on it, at any time.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::stream::STEERING_MAX_RAD;
use fleetcal_estimator::{Estimate, Parameter, Status};
use fleetcal_robot::simulator::{DriveSample, Route, SimulatedMessage, SimulationConfig};

use crate::drive::{Driven, FOUR, drive_disturbed, error_of, poses, vehicle_of};

const DURATION_S: f64 = 181.0;
const SEEDS: [u64; 2] = [1, 2];
const YEAR_NS: i64 = 365 * 86_400 * 1_000_000_000;

/// A robot on a route whose wheel odometry is changed by `of`; samples of no physical size are
/// refused before an estimator receives them.
fn driven(route: Route, seed: u64, mut of: impl FnMut(u64, &mut DriveSample)) -> Driven {
    let mut config = SimulationConfig::figure_eight(seed);
    config.route = route;
    config.lidar = poses();
    config.vehicle.steering_offset_rad = 0.02;
    let vehicle = vehicle_of(&config.vehicle, config.vehicle.wheelbase_m);
    let mut number = 0;
    drive_disturbed(
        config,
        CalibratorConfig::of(vehicle),
        DURATION_S,
        |_, mut message| {
            if let SimulatedMessage::WheelOdometry(sample) = &mut message {
                number += 1;
                of(number, sample);
                if sample.steering_rad.abs() > STEERING_MAX_RAD {
                    return Vec::new();
                }
            }
            vec![message]
        },
    )
}

fn routes() -> [(&'static str, Route); 2] {
    [
        ("eight", Route::staging_figure_eight()),
        ("aisles", Route::aisles_with_reversals()),
    ]
}

fn converged(estimate: &Estimate) -> bool {
    let mut four = FOUR.iter();
    four.any(|&parameter| estimate.parameter(parameter).status == Status::Converged)
}

/// Drives every route with every seed, and asserts that nothing is ever converged.
fn assert_never_converged(name: &str, of: impl Fn(u64, &mut DriveSample)) {
    for (route_name, route) in routes() {
        for seed in SEEDS {
            let driven = driven(route.clone(), seed, &of);
            let first = driven
                .estimates
                .iter()
                .find(|(estimate, _)| converged(estimate));
            let at = first.map(|(estimate, _)| (estimate.time_s, &estimate.parameters));
            assert!(at.is_none(), "{name}, {route_name}, seed {seed}: {at:?}");
        }
    }
}

/// Control of the other tests: the same robots converge.
#[test]
fn the_same_robots_converge_on_what_they_measured() {
    for (name, route) in routes() {
        for seed in SEEDS {
            let driven = driven(route.clone(), seed, |_, _| {});
            let (last, _) = driven.last();
            let all = FOUR.map(|parameter| last.parameter(parameter).status);
            assert_eq!(all, [Status::Converged; 4], "{name}, seed {seed}");
        }
    }
}

/// Robots with a fast steering box: the way straight ahead shows the LiDAR's yaw, which may be
/// known.
#[test]
fn the_angle_of_a_fast_steering_box_leads_to_no_false_claim() {
    for (name, route) in routes() {
        for seed in SEEDS {
            let driven = driven(route.clone(), seed, |_, sample| sample.steering_rad *= 5.0);
            for (estimate, truth) in &driven.estimates {
                for parameter in [Parameter::LidarX, Parameter::LidarY, Parameter::LidarYaw] {
                    let told = estimate.parameter(parameter);
                    let sigmas = error_of(parameter, estimate, truth).abs() / told.sigma;
                    let is_false = told.status == Status::Converged && sigmas > 4.0;
                    assert!(
                        !is_false,
                        "{name}, seed {seed}, {:.0} s: {parameter:?} by {sigmas} sigma",
                        estimate.time_s
                    );
                }
            }
        }
    }
}

/// The angle of a steering column: fifteen times the wheels', and often more than they could.
#[test]
fn the_angle_of_a_steering_column_teaches_nothing() {
    assert_never_converged("column", |_, sample| sample.steering_rad *= 15.0);
}

#[test]
fn degrees_for_radians_teach_nothing() {
    assert_never_converged("degrees", |_, sample| {
        sample.steering_rad = sample.steering_rad.to_degrees();
    });
}

#[test]
fn steering_that_turns_the_other_way_teaches_nothing() {
    assert_never_converged("wrong sign", |_, sample| {
        sample.steering_rad = -sample.steering_rad;
    });
}

/// Encoders that make the NIS a hundred times too large and more.
#[test]
fn a_dead_or_random_encoder_teaches_nothing() {
    assert_never_converged("dead", |_, sample| sample.steering_rad = 0.0);
    assert_never_converged("random", |number, sample| {
        // Weyl's sequence: as good as chance here, and the same each time.
        let chance = (number as f64 * 0.618_033_988_749_894_9).fract();
        sample.steering_rad = chance - 0.5;
    });
}

#[test]
fn samples_of_which_most_come_too_late_teach_nothing() {
    assert_never_converged("late", |number, sample| {
        if number % 10 < 8 {
            sample.stamp_ns -= 20_000_000_000;
        }
    });
}

#[test]
fn samples_that_are_all_years_ahead_teach_nothing() {
    assert_never_converged("years ahead", |_, sample| sample.stamp_ns += 3 * YEAR_NS);
}

/// A few of them are dropped, and nothing else happens.
#[test]
fn single_samples_that_are_years_ahead_do_no_harm() {
    for (name, route) in routes() {
        for seed in SEEDS {
            let driven = driven(route.clone(), seed, |number, sample| {
                if number % 500 == 0 {
                    sample.stamp_ns += 3 * YEAR_NS;
                }
            });
            assert!(driven.changes.is_empty(), "{name}: {:?}", driven.changes);
            let (last, truth) = driven.last();
            assert!(last.counts.late > 30, "{:?}", last.counts);
            for parameter in FOUR {
                let told = last.parameter(parameter);
                assert_eq!(told.status, Status::Converged, "{name}: {parameter:?}");
                let sigmas = error_of(parameter, last, truth).abs() / told.sigma;
                assert!(sigmas <= 4.0, "{name}: {parameter:?} by {sigmas} sigma");
            }
        }
    }
}
