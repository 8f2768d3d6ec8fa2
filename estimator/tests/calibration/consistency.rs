//! Consistency of the sigmas: normalised errors over fixed seeds must lie inside their chi-squared
//! bands.

use fleetcal_estimator::Parameter;
use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_robot::simulator::{Pose2, SimulationConfig};

use crate::drawn::{drawn, drawn_with_white_noise};
use crate::drive::{Driven, FOUR, drive, error_of, nees, vehicle_of};

struct Band {
    nees: f64,
    nis: f64,
    per_parameter: [f64; 4],
}

fn mean_at(runs: &[(Driven, f64)], time_s: f64) -> Band {
    let count = runs.len() as f64;
    let mut band = Band {
        nees: 0.0,
        nis: 0.0,
        per_parameter: [0.0; 4],
    };
    for (run, nees) in runs {
        let (estimate, truth) = run.at(time_s);
        band.nees += nees / count;
        band.nis += estimate.consistency.nis_mean / count;
        for (sum, p) in band.per_parameter.iter_mut().zip(FOUR) {
            let z = error_of(p, estimate, truth) / estimate.parameter(p).sigma;
            *sum += z * z / count;
        }
    }
    band
}

#[test]
fn normalised_errors_lie_inside_their_band_on_lidar_poses() {
    for time_s in [20.0, 60.0, 120.0] {
        let runs: Vec<_> = (1..=60)
            .map(|seed| {
                let (config, calibrator) = drawn_with_white_noise(seed);
                let run = drive(config, calibrator, time_s);
                let nees = nees(&run.calibrator, &run.last().1, false);
                (run, nees)
            })
            .collect();
        let band = mean_at(&runs, time_s);
        println!(
            "{time_s:>4} s: NEES {:.2} (4), NIS {:.2} (3), each {:.2?} (1)",
            band.nees, band.nis, band.per_parameter
        );
        assert!(
            (3.3..=4.8).contains(&band.nees),
            "NEES {} at {time_s} s",
            band.nees
        );
        assert!(
            (2.4..=3.6).contains(&band.nis),
            "NIS {} at {time_s} s",
            band.nis
        );
    }
}

/// Systematic errors stand in the published sigmas alone, on the diagonal.
#[test]
fn the_published_covariance_holds_the_published_sigmas() {
    let (config, calibrator) = drawn(1);
    let run = drive(config, calibrator, 60.0);
    let (estimate, _) = run.last();
    let rows = estimate.covariance.rows();
    for (i, p) in FOUR.into_iter().enumerate() {
        let sigma = estimate.parameter(p).sigma;
        assert!((rows[i][i].sqrt() / sigma - 1.0).abs() < 1e-12);
        for (j, other) in FOUR.into_iter().enumerate() {
            assert!((rows[i][j] - rows[j][i]).abs() < 1e-15);
            assert!(rows[i][j].abs() <= sigma * estimate.parameter(other).sigma);
        }
    }
    // The LiDAR's position is told from yaw and steering by turns, never wholly.
    let correlation = |i: usize, j: usize| rows[i][j] / (rows[i][i] * rows[j][j]).sqrt();
    let pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
    let most = pairs.map(|(i, j)| correlation(i, j).abs());
    println!("correlations {most:.3?}");
    assert!(most.into_iter().fold(0.0, f64::max) > 0.01);
}

#[test]
fn raw_scans_with_people_and_wrong_numbers_are_never_over_confident() {
    let mut mean = 0.0;
    let seeds = 1..=10u64;
    let count = seeds.clone().count() as f64;
    for seed in seeds {
        let (mut config, calibrator) = drawn(seed);
        let scene = SimulationConfig::figure_eight(seed);
        config.lidar = scene.lidar;
        config.people = scene.people;
        config.vehicle.speed_scale = 1.02;
        config.vehicle.time_offset_s = 0.1;
        let run = drive(config, calibrator, 60.0);
        let (estimate, truth) = run.last();
        let nees = nees(&run.calibrator, truth, true);
        println!(
            "seed {seed}: NEES {nees:.2}, errors {:.2?} sigma, changes {:?}",
            FOUR.map(|p| error_of(p, estimate, truth) / estimate.parameter(p).sigma),
            run.changes,
        );
        mean += nees / count;
    }
    println!("mean NEES {mean:.2} (4)");
    assert!(mean <= 4.8, "mean NEES {mean}");
}

/// A robot that believes in a mount 90° and more off begins with violent turns to one side, which
/// leave a direction open.
#[test]
fn a_robot_that_begins_with_turns_to_one_side_is_never_over_confident() {
    // One that looks backwards drives through a wall after 15 s.
    for (yaw_deg, duration_s) in [(170.0_f64, 15.0), (95.0, 40.0)] {
        let mut mean = 0.0;
        let seeds = 1..=8u64;
        let count = seeds.clone().count() as f64;
        for seed in seeds {
            let mut config = SimulationConfig::figure_eight(seed);
            config.vehicle.lidar_in_base = Pose2::new(-0.3, 0.2, yaw_deg.to_radians());
            let vehicle = vehicle_of(&config.vehicle, config.vehicle.wheelbase_m);
            let run = drive(config, CalibratorConfig::of(vehicle), duration_s);
            mean += nees(&run.calibrator, &run.last().1, true) / count;
            for (estimate, truth) in &run.estimates {
                for parameter in FOUR {
                    let error = error_of(parameter, estimate, truth).abs();
                    let sigma = estimate.parameter(parameter).sigma;
                    let name = parameter.name();
                    assert!(
                        error <= 4.0 * sigma,
                        "{yaw_deg}°, seed {seed} at {} s: {name} is off by {error}, sigma {sigma}",
                        estimate.time_s
                    );
                }
            }
        }
        println!("mount {yaw_deg}° off: mean NEES {mean:.2} (4)");
        assert!(mean <= 4.8, "mount {yaw_deg}° off: mean NEES {mean}");
    }
}

#[test]
fn whatever_is_called_converged_lies_within_four_sigma() {
    for seed in 1..=20 {
        let (config, calibrator) = drawn(seed);
        let run = drive(config, calibrator, 90.0);
        for (estimate, truth) in &run.estimates {
            for parameter in Parameter::ALL {
                let found = estimate.parameter(parameter);
                let error = error_of(parameter, estimate, truth);
                assert!(
                    found.status != fleetcal_estimator::Status::Converged
                        || error.abs() <= 4.0 * found.sigma,
                    "seed {seed} at {} s: {} is off by {error}, sigma {}",
                    estimate.time_s,
                    parameter.name(),
                    found.sigma
                );
            }
        }
    }
}
