//! Scanners with the same error in every scan: every converged value is true, and nothing is
//! flagged as a change of the vehicle.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::estimate::{Cause, Change as Changed, ChangeKind};
use fleetcal_estimator::lidar_odometry::BeamTimes;
use fleetcal_estimator::{Parameter, Status};
use fleetcal_robot::simulator::{
    Change, ImperfectionKind, Imperfections, LidarOutput, LidarSettings, Point, Pose2, Route,
    ScheduledChange, SimulatedMessage, SimulationConfig,
};

use crate::drive::{Driven, FOUR, drive, drive_disturbed, error_of, vehicle_of};

/// Sigmas beyond which a converged value is a false claim.
const FALSE_CLAIM_SIGMAS: f64 = 4.0;

/// A robot with raw scans of 720 beams.
fn robot(seed: u64, imperfections: Imperfections) -> SimulationConfig {
    let mut config = SimulationConfig::figure_eight(seed);
    config.lidar = LidarOutput::Scans(LidarSettings {
        beams: 720,
        ..LidarSettings::default()
    });
    config.vehicle.steering_offset_rad = 0.03;
    config.vehicle.lidar_in_base = Pose2::new(0.434, 0.0046, 0.0126);
    config.applied.lidar_in_base = config.vehicle.lidar_in_base;
    config.imperfections = imperfections;
    config
}

/// Drives it, and compares each of the four claims with the truth. No change may be flagged.
fn assert_true(config: SimulationConfig, duration_s: f64, name: &str) -> Driven {
    let run = assert_true_claims(config, duration_s, name);
    assert!(run.changes.is_empty(), "{name}: {:?}", run.changes);
    run
}

fn assert_true_claims(config: SimulationConfig, duration_s: f64, name: &str) -> Driven {
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, config.vehicle.wheelbase_m));
    let run = drive(config, calibrator, duration_s);
    for (estimate, truth) in &run.estimates {
        for parameter in FOUR {
            let found = estimate.parameter(parameter);
            let sigmas = error_of(parameter, estimate, truth).abs() / found.sigma;
            assert!(
                found.status != Status::Converged || sigmas <= FALSE_CLAIM_SIGMAS,
                "{name} at {} s: {} is {sigmas:.1} sigma off, sigma {}",
                estimate.time_s,
                parameter.name(),
                found.sigma
            );
        }
    }
    run
}

/// Its four parameters are converged at the end, x and y to these, m.
fn assert_converged(run: &Driven, x_m: f64, y_m: f64, name: &str) {
    let (estimate, truth) = run.last();
    for parameter in FOUR {
        let found = estimate.parameter(parameter);
        assert_eq!(found.status, Status::Converged, "{name}: {parameter:?}");
    }
    let off_m = [Parameter::LidarX, Parameter::LidarY].map(|p| error_of(p, estimate, truth).abs());
    assert!(off_m[0] < x_m && off_m[1] < y_m, "{name}: {off_m:?}");
}

#[test]
fn ranges_that_are_too_long_do_not_move_the_mount_on_a_loop_to_one_side() {
    for times in [1.0, -1.0] {
        let imperfections = Imperfections::single(ImperfectionKind::RangeBias, times);
        for seed in 1..=2 {
            let mut config = robot(seed, imperfections);
            config.route = Route::left_loop(Point::new(-11.0, 0.0), 9.0, 5.0);
            let name = format!("left loop, bias times {times}, seed {seed}");
            assert_true(config, 120.0, &name);
        }
    }
}

#[test]
fn a_bias_by_incidence_does_not_move_the_mount() {
    let imperfections = Imperfections::strong(ImperfectionKind::IncidenceBias);
    let name = "bias by incidence";
    let run = assert_true(robot(1, imperfections), 90.0, name);
    assert_converged(&run, 0.002, 0.002, name);
}

#[test]
fn a_turning_scanner_without_beam_times_is_no_change_and_no_false_claim() {
    for (rate_hz, stamped_at_end) in [(40.0, false), (40.0, true), (10.0, false), (10.0, true)] {
        let mut imperfections = Imperfections::default();
        imperfections.scanner.untimed_beams = true;
        imperfections.scanner.stamped_at_end = stamped_at_end;
        imperfections.lidar.scan_rate_hz = Some(rate_hz);
        let name = format!("untimed at {rate_hz} Hz, stamped at its end: {stamped_at_end}");
        let run = assert_true(robot(1, imperfections), 90.0, &name);
        assert_converged(&run, 0.002, 0.002, &name);
    }
}

/// Robots with scans of 0.2 s: where one begins to turn, its scan fits the map so poorly that its
/// pose is searched for. That search assumed no acceleration within the scan: these robots were
/// 0.035° to 0.048° off after 120 s, and six of six in a campaign claimed a false yaw after 600 s.
#[test]
fn a_scanner_of_5_hz_does_not_turn_the_mount_on_a_loop_to_one_side() {
    const YAW_OFF_MAX_RAD: f64 = 0.0005;
    for seed in 1..=3 {
        let imperfections = Imperfections::single(ImperfectionKind::ScanRate5Hz, 1.0);
        let mut config = robot(seed, imperfections);
        config.route = Route::left_loop(Point::new(-11.0, 0.0), 10.0, 8.0);
        let name = format!("5 Hz, left loop, seed {seed}");
        let run = assert_true(config, 120.0, &name);
        let (estimate, truth) = run.last();
        let off_rad = error_of(Parameter::LidarYaw, estimate, truth).abs();
        assert!(off_rad < YAW_OFF_MAX_RAD, "{name}: {off_rad}");
    }
}

/// Beams of a tilted scanner that meet the floor 11 m ahead, in a line that comes along with the
/// robot. As a wall it bends the LiDAR's way by degrees: of 180 robots with such a scanner, seven
/// were reported as faulty, again and again.
#[test]
fn a_tilted_scanner_is_no_fault_and_no_false_claim() {
    let routes = [
        (
            "left loop",
            Route::left_loop(Point::new(-11.0, 0.0), 9.0, 5.0),
            true,
        ),
        ("aisles", Route::aisle_loop(), false),
        (
            "figure-eight",
            SimulationConfig::figure_eight(1).route,
            false,
        ),
    ];
    for (name, route, is_one_sided) in routes {
        for (seed, direction_rad) in [(1, 0.965), (2, 1.944), (3, -0.5), (4, 0.0)] {
            let mut imperfections = Imperfections::single(ImperfectionKind::Tilt, 1.0);
            imperfections.scanner.tilt_direction_rad = direction_rad;
            let mut config = robot(seed, imperfections);
            config.route = route.clone();
            let name = format!("{name}, tilted towards {direction_rad} rad");
            let run = assert_true_claims(config, 120.0, &name);
            // Who knew the calibration before the floor was found is told that it was right.
            let confirms = |change: &Changed| change.kind == ChangeKind::CalibrationConfirmed;
            assert!(
                run.changes.iter().all(confirms),
                "{name}: {:?}",
                run.changes
            );
            let floor = run.calibrator.scanner().floor.expect(&name);
            assert!(
                (floor.distance_m() - 11.46).abs() < 0.15,
                "{name}: {floor:?}"
            );
            if !is_one_sided {
                assert_converged(&run, 0.003, 0.005, &name);
            }
        }
    }
}

/// Slow scanner that sees the floor and may be judged not to turn. Its odometry then bends once a
/// lap: three robots, this one on three routes, reported 46 faults in half an hour.
#[test]
fn a_scanner_that_turns_after_all_is_no_fault_and_no_false_claim() {
    let left_loop = Route::left_loop(Point::new(-11.0, 0.0), 10.0, 8.0);
    for (seed, scan_s) in [(89, 0.1837), (38, 0.1632)] {
        let mut config = robot(seed, Imperfections::all_typical(seed, true));
        config.route = left_loop.clone();
        let name = format!("every imperfection, seed {seed}");
        assert_turns(&assert_true(config, 150.0, &name), scan_s, &name);
    }
}

/// Robot whose scanner is judged to turn only after minutes on the figure-eight, and only because
/// its losses do not lengthen the time between scans.
#[test]
fn a_scanner_that_turns_after_minutes_makes_no_false_claim() {
    let config = robot(89, Imperfections::all_typical(89, true));
    let run = assert_true_claims(config, 300.0, "figure-eight");
    assert_turns(&run, 0.1837, "figure-eight");
}

fn assert_turns(run: &Driven, scan_s: f64, name: &str) {
    let beam_times = run.calibrator.scanner().beam_times;
    let found_s = match beam_times {
        BeamTimes::Turning { duration_s, .. } => Some(duration_s),
        _ => None,
    };
    assert!(
        found_s.is_some_and(|found_s| (found_s - scan_s).abs() < 0.02 * scan_s),
        "{name}: {beam_times:?}"
    );
}

/// LiDAR that has long been known, turned by half a degree, or put to another place, and tilted by
/// one degree at once: the floor in its view removes what was learnt, but the change is still
/// reported.
#[test]
fn a_lidar_that_is_knocked_out_of_level_after_minutes_is_flagged_as_moved() {
    let by_half_a_degree = Pose2::new(0.0, 0.0, 0.5_f64.to_radians());
    let to_another_place = Pose2::new(0.3, -0.2, 20_f64.to_radians());
    for (name, knocked) in [("turned", by_half_a_degree), ("moved", to_another_place)] {
        assert_knock_is_flagged(name, knocked);
    }
}

fn assert_knock_is_flagged(name: &str, knocked: Pose2) {
    let knocked_s = 320.0;
    let mut config = robot(1, Imperfections::default());
    config.changes = vec![ScheduledChange {
        at_s: knocked_s,
        change: Change::Mount(knocked),
    }];
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, config.vehicle.wheelbase_m));
    let run = drive_disturbed(config, calibrator, 440.0, |time_s, mut message| {
        if let SimulatedMessage::Scan(scan) = &mut message
            && time_s > knocked_s
        {
            let down = 1_f64.to_radians().sin();
            let mut angle_rad = scan.angle_min_rad;
            for range_m in &mut scan.ranges_m {
                let floor_m = 0.2 / (down * (angle_rad - 0.9).cos()).max(1e-9);
                *range_m = range_m.min(floor_m as f32);
                angle_rad += scan.angle_increment_rad;
            }
        }
        vec![message]
    });
    assert!(
        run.estimates
            .iter()
            .any(|(e, _)| e.distance_m > 200.0 && e.time_s < knocked_s)
    );
    assert!(run.calibrator.scanner().floor.is_some());
    let causes: Vec<_> = run
        .changes
        .iter()
        .filter(|change| change.kind == ChangeKind::CalibrationChanged)
        .map(|change| change.cause)
        .collect();
    assert_eq!(causes, [Cause::LidarMount], "{name}: {:?}", run.changes);
    assert_converged(&run, 0.003, 0.005, name);
}
