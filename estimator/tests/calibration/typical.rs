//! Robots with every imperfection at once, of the size of a robot in good order.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::{Parameter, Status};
use fleetcal_robot::simulator::{
    ImperfectionKind, Imperfections, LidarOutput, LidarSettings, Point, Route,
    ScannerImperfections, SimulationConfig, Strength, VehicleImperfections,
};
use rand::{Rng, SeedableRng, rngs::StdRng};
use rand_distr::StandardNormal;

use crate::drawn::drawn;
use crate::drive::{Driven, FOUR, drive, error_of, poses, published_nees, vehicle_of};

/// A tugger of which everything is drawn from the priors that docs/assumptions.md publishes, on the
/// eight or in aisles by its seed. Asymmetry and quadratic curve are small on every other vehicle,
/// as the filter assumes them until the data need more. With the sensors' priors too, every other
/// one has an encoder that nothing makes tremble, and of every 32 vehicles 16 send raw scans of
/// biased ranges, four of them without the times of their beams.
fn drawn_from_priors(seed: u64, sensors_too: bool) -> (SimulationConfig, CalibratorConfig) {
    let (mut config, calibrator) = drawn(seed);
    // Another stream than that of `drawn`, whose vehicles stay the same.
    let mut random = StdRng::seed_from_u64(seed + 1_000_000);
    let mut normal = |sigma: f64| sigma * random.sample::<f64, _>(StandardNormal);
    let curve_rad = 0.3f64.to_radians();
    let share = |small: bool| if small { 0.2 } else { 1.0 };
    let (asymmetry_share, quadratic_share) = (share(seed & 2 == 0), share(seed & 4 == 0));
    let steering_behind_s = normal(0.1);
    config.vehicle.time_offset_s = normal(0.05);
    config.imperfections.vehicle = VehicleImperfections {
        steering_gain: normal(0.02),
        steering_asymmetry: asymmetry_share * normal(0.01),
        steering_quadratic_rad: quadratic_share * normal(curve_rad),
        steering_cubic_rad: normal(curve_rad),
        backlash_rad: normal(0.5f64.to_radians()).abs(),
        steering_lag_s: steering_behind_s.max(0.0),
        steering_delay_s: (-steering_behind_s).max(0.0),
        speed_encoder_y_m: normal(0.05),
        ..VehicleImperfections::default()
    };
    let is = |bit: u64| sensors_too && seed & bit != 0;
    if is(8) {
        config.imperfections.vehicle.undithered_step_rad = 0.25f64.to_radians();
    }
    if is(16) {
        config.lidar = LidarOutput::Scans(LidarSettings::default());
        config.imperfections.scanner = ScannerImperfections {
            range_bias_m: normal(0.03),
            incidence_bias_m: normal(0.01),
            untimed_beams: is(2) && is(4),
            ..ScannerImperfections::default()
        };
    }
    config.imperfections.lidar.range_scale = normal(0.005);
    config.imperfections.clocks.drive_drift = normal(1e-4);
    if seed.is_multiple_of(2) {
        config.route = Route::aisles_with_reversals();
    }
    (config, calibrator)
}

/// The mean over vehicles that are drawn from published priors, at each of `times_s`.
fn published(vehicles: u64, sensors_too: bool, times_s: &[f64]) -> Vec<f64> {
    let last_s = times_s.iter().copied().fold(0.0, f64::max);
    let mut means = vec![0.0; times_s.len()];
    for seed in 1..=vehicles {
        let (config, calibrator) = drawn_from_priors(seed, sensors_too);
        let run = drive(config, calibrator, last_s);
        for (mean, at_s) in means.iter_mut().zip(times_s) {
            let (estimate, truth) = run.at(*at_s);
            *mean += published_nees(estimate, truth) / vehicles as f64;
        }
    }
    println!("{vehicles} vehicles: mean NEES {means:.2?} (4) at {times_s:?} s");
    means
}

/// Neither too sure nor too careful. Were the errors Gaussian, the mean of 48 would have a standard
/// deviation of 0.41.
#[test]
fn published_errors_of_vehicles_drawn_from_the_priors_lie_inside_their_band() {
    for nees in published(48, false, &[60.0, 120.0]) {
        assert!((2.4..=5.6).contains(&nees), "mean NEES {nees}");
    }
}

#[test]
#[ignore = "200 drives of 300 s; make published-errors"]
fn published_errors_of_200_vehicles_lie_inside_their_band() {
    for nees in published(200, false, &[60.0, 120.0, 300.0]) {
        assert!((3.0..=5.0).contains(&nees), "mean NEES {nees}");
    }
}

/// The same with their sensors drawn too.
#[test]
#[ignore = "200 drives of 300 s; make published-errors"]
fn published_errors_of_200_vehicles_with_drawn_sensors_lie_inside_their_band() {
    for nees in published(200, true, &[60.0, 120.0, 300.0]) {
        assert!((3.0..=5.0).contains(&nees), "mean NEES {nees}");
    }
}

fn routes() -> [(&'static str, Route); 3] {
    [
        ("eight", Route::staging_figure_eight()),
        ("aisles", Route::aisles_with_reversals()),
        ("left", Route::left_loop(Point::new(-11.0, 0.0), 10.0, 8.0)),
    ]
}

fn drive_on(route: Route, imperfections: Imperfections, seed: u64, duration_s: f64) -> Driven {
    let mut config = SimulationConfig::figure_eight(seed);
    config.route = route;
    config.lidar = poses();
    config.people.count = 0;
    config.vehicle.steering_offset_rad = 0.02;
    config.imperfections = imperfections;
    let known_m = config.configured_wheelbase_m();
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, known_m));
    drive(config, calibrator, duration_s)
}

/// Asserts that every `converged` value is true at any time, and that no change is flagged.
fn assert_true(run: &Driven, name: &str) {
    assert!(run.changes.is_empty(), "{name}: {:?}", run.changes);
    for (estimate, truth) in &run.estimates {
        for parameter in FOUR {
            let found = estimate.parameter(parameter);
            let error = error_of(parameter, estimate, truth).abs();
            assert!(
                found.status != Status::Converged || error <= 4.0 * found.sigma,
                "{name} at {} s: {} off by {error}, {found:?}",
                estimate.time_s,
                parameter.name()
            );
        }
    }
}

/// Robots with all typical imperfections, among them a speed encoder beside the axle and a curve of
/// the steering that hide each other: where nobody stated where the speed is measured, the LiDAR's
/// y is not claimed on a robot that is imperfect in many ways.
#[test]
fn a_robot_with_all_typical_imperfections_makes_no_false_claim() {
    for (route_name, route) in routes() {
        for seed in 1..=8 {
            let imperfections = Imperfections::all_typical(seed, false);
            let run = drive_on(route.clone(), imperfections, seed, 240.0);
            assert_true(&run, &format!("{route_name}, seed {seed}"));
        }
    }
}

/// Robots of which every turn is a left one: imperfections that work together pass for an offset,
/// and ten minutes of driving do not remove it. These seeds were false while the filter's own sigma
/// was published; of 600, two still are (147 and 346, and here 541).
#[test]
fn an_imperfect_robot_on_a_loop_of_left_turns_makes_no_false_claim() {
    let left = Route::left_loop(Point::new(-11.0, 0.0), 10.0, 8.0);
    for seed in [108, 290, 306, 363, 409] {
        let imperfections = Imperfections::all_typical(seed, false);
        let run = drive_on(left.clone(), imperfections, seed, 600.0);
        assert_true(&run, &format!("seed {seed}"));
        let is_claimed = run.estimates.iter().any(|(estimate, _)| {
            estimate.parameter(Parameter::SteeringOffset).status == Status::Converged
        });
        assert!(is_claimed, "seed {seed}");
    }
}

/// Robot whose owner has to state where the speed is measured: no driving shows it, so none is
/// asked for.
#[test]
fn a_robot_whose_y_waits_for_the_place_of_its_speed_encoder_says_so() {
    let (route_name, route) = routes()[0].clone();
    let imperfections = Imperfections::all_typical(1, false);
    let run = drive_on(route, imperfections, 1, 240.0);
    let (estimate, _) = run.last();
    let lidar_y = estimate.parameter(Parameter::LidarY);
    assert_eq!(lidar_y.status, Status::Learning, "{route_name}");
    let needs = lidar_y.needs.clone().unwrap_or_default();
    assert!(needs.contains("speed_measured_at"), "{lidar_y:?}");
}

/// 100 ppm between the clocks of wheel odometry and LiDAR.
#[test]
fn clocks_that_drift_apart_are_no_change() {
    for (route_name, route) in routes() {
        for seed in 1..=6 {
            let kind = ImperfectionKind::ClockDrift;
            let imperfections = Imperfections::drawn(kind, Strength::Typical, seed);
            let run = drive_on(route.clone(), imperfections, seed, 600.0);
            assert_true(&run, &format!("{route_name}, seed {seed}"));
        }
    }
}

/// A step of 0.75 degrees, and nothing that makes the wheel tremble: on a loop to one side every straight
/// shows the same wrong reading.
#[test]
fn a_coarse_encoder_that_shows_one_reading_on_every_straight_is_not_believed_beyond_its_step() {
    let (route_name, route) = routes()[2].clone();
    for seed in 1..=6 {
        let kind = ImperfectionKind::EncoderSteps;
        let imperfections = Imperfections::drawn(kind, Strength::Strong, seed);
        let run = drive_on(route.clone(), imperfections, seed, 240.0);
        assert_true(&run, &format!("{route_name}, seed {seed}"));
    }
}

/// Rear wheels of unequal size, which shift the estimate of the LiDAR's y by millimetres, and show
/// only as a steering curve too small to see. Of seeds 1 to 150 on these two routes, these were
/// false at some moment, by up to 4.7 sigmas; the constant was chosen on them.
#[test]
fn a_robot_with_unequal_wheels_makes_no_false_claim() {
    let [(_, eight), (_, aisles), _] = routes();
    let eights = [26, 40, 57, 64].map(|seed| (&eight, seed));
    let on_aisles = [26, 103].map(|seed| (&aisles, seed));
    for (route, seed) in eights.into_iter().chain(on_aisles) {
        let kind = ImperfectionKind::WheelSizes;
        let imperfections = Imperfections::drawn(kind, Strength::Typical, seed);
        let run = drive_on(route.clone(), imperfections, seed, 600.0);
        assert_true(&run, &format!("seed {seed}"));
        let claims_y = run
            .estimates
            .iter()
            .any(|(estimate, _)| estimate.parameter(Parameter::LidarY).status == Status::Converged);
        assert!(claims_y, "seed {seed}");
    }
}
