//! Observability: a motion that cannot show a parameter leaves it unknown, with the missing motion named.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::vehicle::SpeedMeasuredAt;
use fleetcal_estimator::{Parameter, Status};
use fleetcal_robot::simulator::{Point, Pose2, Route, SimulationConfig};

use crate::drive::{Driven, FOUR, drive, error_of, poses, vehicle_of};

fn on_route(route: Route, duration_s: f64) -> Driven {
    let mut config = SimulationConfig::figure_eight(7);
    config.route = route;
    config.lidar = poses();
    config.vehicle.steering_offset_rad = 0.02;
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, config.vehicle.wheelbase_m));
    drive(config, calibrator, duration_s)
}

fn assert_mount_is_open(run: &Driven) {
    let (estimate, _) = run.last();
    for parameter in [Parameter::LidarX, Parameter::LidarY] {
        let found = estimate.parameter(parameter);
        assert_ne!(
            found.status,
            Status::Converged,
            "{}: {found:?}",
            parameter.name()
        );
        let needs = found.needs.as_deref().unwrap_or_default();
        assert!(
            needs.contains("turn") || needs.contains("straight"),
            "needs {needs:?}"
        );
    }
}

#[test]
fn straight_driving_leaves_the_mount_open_and_finds_the_steering_zero() {
    let run = on_route(
        Route::straight(Point::new(0.0, 0.0), Point::new(60.0, 0.0)),
        50.0,
    );
    assert_mount_is_open(&run);
    let (estimate, truth) = run.last();
    let offset = estimate.parameter(Parameter::SteeringOffset);
    assert_eq!(offset.status, Status::Converged);
    let error = error_of(Parameter::SteeringOffset, estimate, truth);
    assert!(error.abs() < 0.05f64.to_radians(), "{error}, {offset:?}");
}

#[test]
fn one_circle_leaves_the_mount_open() {
    assert_mount_is_open(&on_route(Route::circle(Point::new(0.0, 0.0), 4.0), 60.0));
}

/// Oval without a straight, which shows the other values, but not how the body points against where
/// its rear axle rolls: yaw is published no surer than that.
#[test]
fn turning_to_one_side_alone_leaves_the_yaw_open() {
    let points: Vec<_> = (0..180)
        .map(|i| std::f64::consts::TAU * f64::from(i) / 180.0)
        .map(|around| Point::new(5.0 * around.cos(), 3.0 * around.sin()))
        .collect();
    let run = on_route(Route::from_points(&points, true), 240.0);
    let yaw = run.last().0.parameter(Parameter::LidarYaw);
    assert_ne!(yaw.status, Status::Converged);
    assert!(yaw.sigma > 0.25f64.to_radians());
    let needs = yaw.needs.clone().unwrap_or_default();
    assert!(needs.contains("turns to both sides"), "{needs}");
}

/// Six laps to the left, then four to the right.
fn left_laps_then_right_laps() -> Route {
    let lap = |side_m: f64| {
        [(0.0, 0.0), (10.0, 0.0), (10.0, side_m), (0.0, side_m)]
            .map(|(x_m, y_m)| Point::new(x_m, y_m))
    };
    let (left, right) = (lap(8.0).repeat(6), lap(-8.0).repeat(4));
    Route::through(&[left, right].concat(), 1.8, true)
}

/// Laps to one side never show the steering's curve, behind which an encoder beside the axle may
/// hide: `y` waits for turns to the other side, or for its owner to state where the speed is
/// measured.
#[test]
fn y_waits_for_turns_to_the_other_side() {
    const LEFT_LAPS_M: f64 = 190.0;
    for seed in 1..=6 {
        let mut config = SimulationConfig::figure_eight(seed);
        config.route = left_laps_then_right_laps();
        config.lidar = poses();
        let vehicle = vehicle_of(&config.vehicle, config.vehicle.wheelbase_m);
        let mut named = CalibratorConfig::of(vehicle);
        named.vehicle.speed_measured_at = SpeedMeasuredAt::RearWheel { lateral_m: 0.0 };
        let run = drive(config.clone(), CalibratorConfig::of(vehicle), 420.0);
        let laps = |run: &Driven| {
            let mut estimates = run.estimates.iter().rev();
            let (estimate, _) = estimates.find(|(e, _)| e.distance_m < LEFT_LAPS_M).unwrap();
            estimate.parameter(Parameter::LidarY).clone()
        };
        let y = laps(&run);
        assert_eq!(y.status, Status::Learning, "seed {seed}: {y:?}");
        let needs = y.needs.clone().unwrap_or_default();
        for remedy in ["turns to both sides", "speed_measured_at"] {
            assert!(needs.contains(remedy), "seed {seed}: {needs}");
        }
        let y = run.last().0.parameter(Parameter::LidarY);
        assert_eq!(y.status, Status::Converged, "seed {seed}: {y:?}");
        let y = laps(&drive(config, named, 300.0));
        assert_eq!(y.status, Status::Converged, "seed {seed}: {y:?}");
    }
}

#[test]
fn standing_still_says_nothing() {
    let mut config = SimulationConfig::figure_eight(7);
    config.speed.rest_s = 1000.0;
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, 1.2));
    let run = drive(config, calibrator, 30.0);
    for parameter in FOUR {
        assert_eq!(
            run.last().0.parameter(parameter).status,
            Status::Unobservable
        );
    }
}

#[test]
fn any_mount_and_any_offset_converge_from_nothing() {
    for i in 0..11 {
        let around = std::f64::consts::TAU * f64::from(i) / 11.0;
        let mut config = SimulationConfig::figure_eight(20 + i as u64);
        config.people.count = 0;
        config.lidar = poses();
        config.vehicle.lidar_in_base =
            Pose2::new(1.5 * around.cos(), 0.8 * around.sin(), around - 3.0);
        config.vehicle.steering_offset_rad = if i % 2 == 0 { 0.157 } else { -0.157 };
        config.applied.lidar_in_base = config.vehicle.lidar_in_base;
        config.applied.steering_offset_rad = config.vehicle.steering_offset_rad;
        let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, 1.2));
        let run = drive(config, calibrator, 90.0);
        let (estimate, truth) = run.last();
        for parameter in FOUR {
            let found = estimate.parameter(parameter);
            let error = error_of(parameter, estimate, truth);
            assert_eq!(
                found.status,
                Status::Converged,
                "mount {i}: {} {found:?}",
                parameter.name()
            );
            assert!(
                error.abs() <= 4.0 * found.sigma,
                "mount {i}: {} {error}",
                parameter.name()
            );
        }
    }
}
