//! The simulator against analytic answers.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

use super::*;

fn quiet_lidar() -> LidarSettings {
    LidarSettings {
        range_sigma_m: 0.0,
        ..LidarSettings::default()
    }
}

fn quiet_vehicle() -> VehicleTruth {
    VehicleTruth {
        slip: Slip::default(),
        ..VehicleTruth::default()
    }
}

fn exact_drive() -> DriveSettings {
    DriveSettings {
        speed_sigma_mps: 0.0,
        steering_sigma_rad: 0.0,
        steering_step_rad: 0.0,
        ..DriveSettings::default()
    }
}

fn poses_only() -> LidarOutput {
    LidarOutput::Poses(PoseSettings {
        position_sigma_m: 0.0,
        yaw_sigma_rad: 0.0,
        ..PoseSettings::default()
    })
}

fn run(config: SimulationConfig, duration_s: f64) -> Vec<Emitted> {
    Simulation::new(config).unwrap().run(duration_s)
}

fn scans(messages: &[Emitted]) -> Vec<(&Scan, &Emitted)> {
    let scan = |emitted: &'_ Emitted| matches!(emitted.message, SimulatedMessage::Scan(_));
    messages
        .iter()
        .filter(|emitted| scan(emitted))
        .map(|emitted| match &emitted.message {
            SimulatedMessage::Scan(scan) => (scan, emitted),
            other => panic!("not a scan: {other:?}"),
        })
        .collect()
}

fn drives(messages: &[Emitted]) -> Vec<(DriveSample, &Emitted)> {
    messages
        .iter()
        .filter_map(|emitted| match emitted.message {
            SimulatedMessage::WheelOdometry(drive) => Some((drive, emitted)),
            _ => None,
        })
        .collect()
}

/// Returns the root mean square of the true cross-track error after `from_s`.
fn true_error_m(messages: &[Emitted], from_s: f64) -> f64 {
    let start_ns = messages[0].message.stamp_ns();
    let late: Vec<_> = messages
        .iter()
        .filter(|emitted| (emitted.sent_ns - start_ns) as f64 * 1e-9 > from_s)
        .map(|emitted| emitted.truth_when_sent.cross_track_error_m.powi(2))
        .collect();
    (late.iter().sum::<f64>() / late.len() as f64).sqrt()
}

#[test]
fn a_ray_meets_walls_and_pillars_at_the_analytic_distance() {
    let room = Area::around(Point::default(), 10.0, 6.0);
    let pillar = Pillar {
        centre: Point::new(2.0, 2.0),
        radius_m: 0.5,
    };
    let world = World::new(room.sides().to_vec(), vec![pillar], Vec::new());
    let origin = Point::new(-1.0, -1.0);
    let close = |bearing_rad: f64, expected_m: f64| {
        let range_m = world.range_m(origin, bearing_rad, 40.0).unwrap();
        assert!(
            (range_m - expected_m).abs() < 1e-9,
            "{bearing_rad}: {range_m} {expected_m}"
        );
    };
    close(0.0, 6.0);
    close(PI, 4.0);
    close(FRAC_PI_2, 4.0);
    close(-FRAC_PI_2, 2.0);
    close(-0.75 * PI, 2.0 * 2.0_f64.sqrt());
    close(FRAC_PI_2 / 2.0, 18.0_f64.sqrt() - 0.5);
    assert_eq!(world.range_m(origin, 0.0, 5.9), None);
    assert_eq!(world.range_m(Point::new(50.0, 0.0), PI, 100.0), None);
}

#[test]
fn the_cells_hide_nothing_from_any_ray() {
    let world = World::warehouse(7);
    for number in 0..4000 {
        let n = f64::from(number);
        let origin = Point::new(-17.0 + (n * 0.37) % 12.0, -9.0 + (n * 0.73) % 18.0);
        let bearing_rad = n * 2.399;
        let (sin, cos) = f64::sin_cos(bearing_rad);
        let brute = world
            .segments()
            .iter()
            .map(|segment| {
                let (ex, ey) = (
                    segment.to.x_m - segment.from.x_m,
                    segment.to.y_m - segment.from.y_m,
                );
                let (dx, dy) = (segment.from.x_m - origin.x_m, segment.from.y_m - origin.y_m);
                let determinant = cos * ey - sin * ex;
                let (t, s) = (
                    (dx * ey - dy * ex) / determinant,
                    (dx * sin - dy * cos) / determinant,
                );
                if t > 0.0 && (0.0..=1.0).contains(&s) {
                    t
                } else {
                    f64::INFINITY
                }
            })
            .chain(world.pillars().iter().map(|pillar| {
                let (dx, dy) = (
                    pillar.centre.x_m - origin.x_m,
                    pillar.centre.y_m - origin.y_m,
                );
                let across = dx * sin - dy * cos;
                let chord = pillar.radius_m.powi(2) - across * across;
                let t = dx * cos + dy * sin - chord.max(0.0).sqrt();
                if chord >= 0.0 && t > 0.0 {
                    t
                } else {
                    f64::INFINITY
                }
            }))
            .fold(f64::INFINITY, f64::min);
        let range_m = world
            .range_m(origin, bearing_rad, 100.0)
            .unwrap_or(f64::INFINITY);
        assert!(
            (range_m - brute).abs() < 1e-9,
            "{origin:?} {bearing_rad}: {range_m} {brute}"
        );
    }
}

#[test]
fn each_beam_is_cast_from_its_own_moment() {
    for (field_of_view_rad, clockwise, instantaneous) in [
        (TAU, false, false),
        (TAU, true, false),
        (4.7, false, false),
        (4.7, true, true),
    ] {
        let mut config = SimulationConfig::figure_eight(3);
        config.people.count = 0;
        let settings = LidarSettings {
            field_of_view_rad,
            clockwise,
            instantaneous,
            ..quiet_lidar()
        };
        config.lidar = LidarOutput::Scans(settings);
        let mut truths = config.clone();
        let world = Arc::clone(&config.world);
        let messages = run(config, 14.0);
        let (scan, _) = *scans(&messages).last().unwrap();
        // The same drive again with a pose stream at 1 kHz tells where the LiDAR was.
        truths.lidar = LidarOutput::Poses(PoseSettings {
            rate_hz: 1000.0,
            phase_s: 0.0,
            ..PoseSettings::default()
        });
        let truths = run(truths, 14.1);
        let poses: Vec<_> = truths
            .iter()
            .filter(|emitted| matches!(emitted.message, SimulatedMessage::LidarPose(_)))
            .map(|emitted| emitted.truth)
            .collect();
        let lidar_at = |stamp_ns: i64| {
            let after = poses.partition_point(|truth| truth.stamp_ns <= stamp_ns);
            let (before, after) = (poses[after - 1], poses[after]);
            let fraction = (stamp_ns - before.stamp_ns) as f64 * 1e-6;
            before.lidar.toward(&after.lidar, fraction)
        };
        for beam in 0..scan.ranges_m.len() {
            let offset_ns = (beam as f64 * scan.time_increment_s * 1e9) as i64;
            let pose = lidar_at(scan.stamp_ns + offset_ns);
            let bearing_rad =
                pose.yaw_rad + scan.angle_min_rad + beam as f64 * scan.angle_increment_rad;
            let expected_m = world.range_m(pose.point(), bearing_rad, 40.0).unwrap();
            let range_m = f64::from(scan.ranges_m[beam]);
            assert!(
                (range_m - expected_m).abs() < 1e-5,
                "beam {beam}: {range_m} {expected_m}"
            );
        }
    }
}

#[test]
fn a_left_turn_moves_a_lidar_ahead_of_the_axle_to_its_left() {
    let mut config = SimulationConfig::figure_eight(1);
    config.route = Route::circle(Point::new(-11.0, 0.0), 4.0);
    config.lidar = poses_only();
    let messages = run(config, 4.0);
    let last = messages
        .iter()
        .rev()
        .find_map(|emitted| match emitted.message {
            SimulatedMessage::LidarPose(pose) => Some(pose.pose),
            _ => None,
        })
        .unwrap();
    assert!(
        last.yaw_rad > 0.1 && last.y_m > 0.434 * 0.5 * last.yaw_rad,
        "{last:?}"
    );
}

#[test]
fn the_same_seed_gives_the_same_messages_and_another_one_others() {
    let messages = |seed| format!("{:?}", run(SimulationConfig::figure_eight(seed), 5.0));
    assert_eq!(messages(4), messages(4));
    assert_ne!(messages(4), messages(5));
}

#[test]
fn integrating_the_samples_over_the_interval_before_each_stamp_gives_the_true_path() {
    for (model, turns) in [
        (VehicleModel::Bicycle, 1.0),
        (VehicleModel::Tricycle, 1.0),
        (VehicleModel::RearSteered, -1.0),
    ] {
        let mut config = SimulationConfig::figure_eight(2);
        config.vehicle = VehicleTruth {
            model,
            steering_offset_rad: 0.05,
            steering_gain: 0.97,
            speed_scale: 1.02,
            time_offset_s: 0.08,
            ..quiet_vehicle()
        };
        config.drive = exact_drive();
        config.lidar = poses_only();
        let vehicle = config.vehicle;
        let start = config.route.start();
        let start_ns = config.start_stamp_ns;
        let messages = run(config, 30.0);
        let mut base = start;
        let mut last = start;
        for (drive, emitted) in drives(&messages) {
            let steering_rad = 0.97 * (drive.steering_rad - 0.05);
            let speed_mps = 1.02
                * match model {
                    VehicleModel::Bicycle | VehicleModel::RearSteered => drive.speed_mps,
                    VehicleModel::Tricycle => drive.speed_mps * steering_rad.cos(),
                };
            let yaw_rate = turns * speed_mps * steering_rad.tan() / vehicle.wheelbase_m;
            base = base.compose(&Pose2::arc(speed_mps * 0.01, 0.0, yaw_rate * 0.01));
            last = emitted.truth.base;
            let lag_ns = drive.stamp_ns - emitted.truth.stamp_ns;
            assert_eq!(
                lag_ns, 80_000_000,
                "motion shows 80 ms later in the wheel odometry"
            );
            assert!(emitted.truth.stamp_ns > start_ns);
        }
        let error_m = base.point().distance_m(last.point());
        assert!(error_m < 2e-3, "{model:?}: {error_m} m after 30 s");
        assert!((base.yaw_rad - last.yaw_rad).abs() < 1e-3);
    }
}

#[test]
fn the_robot_drives_at_rest_first_then_between_half_and_one_and_a_half_metres_a_second() {
    let messages = run(SimulationConfig::figure_eight(2), 60.0);
    let drives = drives(&messages);
    assert!(
        drives[..90]
            .iter()
            .all(|(drive, _)| drive.speed_mps.abs() < 1e-9)
    );
    let speeds: Vec<_> = drives[600..]
        .iter()
        .map(|(_, e)| e.truth.speed_mps)
        .collect();
    let max = speeds.iter().copied().fold(0.0, f64::max);
    let min = speeds.iter().copied().fold(9.0, f64::min);
    assert!(min > 0.45 && max > 1.0 && max < 1.55, "{min} to {max} m/s");
    let turns = drives.iter().map(|(_, e)| e.truth.steering_rad);
    let (left, right) = turns.fold((0.0, 0.0), |(l, r), s| (f64::max(l, s), f64::min(r, s)));
    assert!(
        left > 0.3 && right < -0.3,
        "both turns within 60 s: {left} {right}"
    );
}

#[test]
fn a_calibrated_robot_keeps_to_every_route() {
    let free = Arc::new(World::empty_hall());
    let routes = [
        ("figure-eight", Route::staging_figure_eight()),
        ("aisle loop", Route::aisle_loop()),
        ("circle", Route::circle(Point::new(-11.0, 0.0), 3.0)),
        (
            "left loop",
            Route::left_loop(Point::new(-11.0, 0.0), 10.0, 8.0),
        ),
        (
            "straight",
            Route::straight(Point::new(-30.0, 0.0), Point::new(30.0, 0.0)),
        ),
        (
            "slalom",
            Route::slalom(Point::new(-30.0, 0.0), 60.0, 0.8, 12.0),
        ),
    ];
    for (name, route) in routes {
        let mut config = SimulationConfig::figure_eight(2);
        config.world = Arc::clone(&free);
        config.route = route;
        config.lidar = poses_only();
        let error_m = true_error_m(&run(config, 80.0), 5.0);
        assert!(error_m < 0.04, "{name}: {error_m} m");
    }
}

#[test]
fn the_routes_of_the_warehouse_are_free() {
    for seed in 0..20 {
        let world = World::warehouse(seed);
        for route in [Route::staging_figure_eight(), Route::aisle_loop()] {
            let mut along_m = 0.0;
            while along_m < route.length_m() {
                let point = route.point_at(along_m);
                let nearest_m = (0..360)
                    .filter_map(|degree| world.range_m(point, f64::from(degree).to_radians(), 40.0))
                    .fold(f64::INFINITY, f64::min);
                assert!(nearest_m > 0.6, "seed {seed}: {nearest_m} m at {point:?}");
                along_m += 0.5;
            }
        }
    }
}

#[test]
fn a_steering_offset_shows_beside_the_path_until_it_is_applied() {
    let mut config = SimulationConfig::figure_eight(2);
    config.lidar = poses_only();
    let calibrated_m = true_error_m(&run(config.clone(), 60.0), 5.0);
    config.vehicle.steering_offset_rad = 3.0_f64.to_radians();
    let mut simulation = Simulation::new(config).unwrap();
    let off_m = true_error_m(&simulation.run(60.0), 5.0);
    let mut applied = simulation.applied();
    applied.steering_offset_rad = 3.0_f64.to_radians();
    simulation.set_applied(applied);
    let mended_m = true_error_m(&simulation.run(60.0), 5.0);
    assert!(
        off_m > 2.0 * calibrated_m && off_m > 0.02,
        "{off_m} m, calibrated {calibrated_m} m"
    );
    assert!(
        (mended_m - calibrated_m).abs() < 0.005,
        "{mended_m} m after, {calibrated_m} m"
    );
}

#[test]
fn a_wrong_mount_shows_beside_the_path_until_it_is_applied() {
    let mut config = SimulationConfig::figure_eight(2);
    config.lidar = poses_only();
    config.vehicle.lidar_in_base = Pose2::new(0.45, 0.05, 2.0_f64.to_radians());
    let mut simulation = Simulation::new(config.clone()).unwrap();
    let off_m = true_error_m(&simulation.run(60.0), 5.0);
    let lidar_in_base = config.vehicle.lidar_in_base;
    simulation.set_applied(Applied {
        lidar_in_base,
        ..simulation.applied()
    });
    let mended_m = true_error_m(&simulation.run(60.0), 5.0);
    assert!(
        off_m > 2.0 * mended_m,
        "{off_m} m before, {mended_m} m after"
    );
}

#[test]
fn changes_happen_when_they_are_due() {
    let mut config = SimulationConfig::figure_eight(2);
    config.lidar = poses_only();
    let at = |at_s, change| ScheduledChange { at_s, change };
    config.changes = vec![
        at(3.0, Change::Mount(Pose2::new(0.02, -0.01, 0.03))),
        at(1.0, Change::SteeringOffset(0.04)),
        at(5.0, Change::SteeringDrift(0.001)),
        at(6.0, Change::SteeringDrift(0.0)),
    ];
    let mut simulation = Simulation::new(config).unwrap();
    let offset_rad = |simulation: &Simulation| simulation.parameters().steering_offset_rad;
    simulation.run(0.9);
    assert!(offset_rad(&simulation).abs() < 1e-12);
    simulation.run(1.0);
    assert!((offset_rad(&simulation) - 0.04).abs() < 1e-12);
    let before = simulation.parameters().lidar_in_base;
    simulation.run(2.0);
    let after = simulation.parameters().lidar_in_base;
    assert!((after.x_m - before.x_m - 0.02).abs() < 1e-12);
    assert!((after.yaw_rad - before.yaw_rad - 0.03).abs() < 1e-12);
    simulation.run(5.0);
    assert!((offset_rad(&simulation) - 0.041).abs() < 2e-6);
}

#[test]
fn people_are_seen_and_step_aside() {
    let mut config = SimulationConfig::figure_eight(6);
    config.people.count = 0;
    let empty = run(config.clone(), 20.0);
    config.people.count = 60;
    let crowded = run(config, 20.0);
    let mut nearer = 0;
    for ((scan, _), (with_people, _)) in scans(&empty).iter().zip(scans(&crowded)) {
        for (range_m, person_m) in scan.ranges_m.iter().zip(&with_people.ranges_m) {
            assert!(
                person_m <= range_m || !range_m.is_finite(),
                "people hide, never reveal"
            );
            assert!(
                *person_m > 0.6,
                "nobody within a person's reach: {person_m}"
            );
            nearer += usize::from(person_m + 0.2 < *range_m);
        }
    }
    let seen = nearer as f64 / scans(&empty).len() as f64;
    assert!(seen > 20.0, "{seen} beams of 1024 on people");
}

#[test]
fn a_scan_is_sent_after_its_last_beam_and_ranges_outside_the_limits_are_no_returns() {
    let mut config = SimulationConfig::figure_eight(6);
    let settings = LidarSettings {
        beams: 360,
        range_max_m: 6.0,
        dropped_beams: 0.1,
        ..LidarSettings::default()
    };
    config.lidar = LidarOutput::Scans(settings);
    let messages = run(config, 5.0);
    let scans = scans(&messages);
    assert_eq!(scans.len(), 49);
    for (scan, emitted) in &scans {
        assert_eq!(scan.ranges_m.len(), 360);
        assert_eq!(emitted.sent_ns - scan.stamp_ns, 100_000_000);
        assert!((emitted.truth.stamp_ns - scan.stamp_ns - 49_861_111).abs() <= 1);
        assert_eq!(emitted.truth_when_sent.stamp_ns, emitted.sent_ns);
        let fine = |range: &f32| *range == f32::INFINITY || (0.2..=6.0).contains(range);
        assert!(scan.ranges_m.iter().all(fine));
    }
    let stamps: Vec<_> = messages
        .iter()
        .map(|emitted| emitted.message.stamp_ns())
        .collect();
    assert!(stamps.is_sorted());
}

#[test]
fn a_setting_that_cannot_be_is_refused_by_name() {
    let refused = |spoil: &dyn Fn(&mut SimulationConfig)| {
        let mut config = SimulationConfig::figure_eight(1);
        spoil(&mut config);
        Simulation::new(config).unwrap_err().to_string()
    };
    assert_eq!(
        refused(&|config| config.vehicle.wheelbase_m = f64::NAN),
        "vehicle.wheelbase_m: got NaN, expected 0.1 to 20 m"
    );
    assert_eq!(
        refused(&|config| config.people.count = 61),
        "people.count: got 61, expected at most 60"
    );
    let beams = |beams| {
        LidarOutput::Scans(LidarSettings {
            beams,
            ..LidarSettings::default()
        })
    };
    assert_eq!(
        refused(&|config| config.lidar = beams(4)),
        "lidar.beams: got 4, expected 8 to 16384"
    );
    let nowhere = Route::from_points(&[Point::default()], false);
    assert!(refused(&|config| config.route = nowhere.clone()).starts_with("route.length_m: got 0"));
}
