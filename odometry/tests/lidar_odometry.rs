//! LiDAR odometry against the truth of a simulated hall: accuracy, honesty and failures.

mod scene;

use fleetcal_odometry::ScanShape;
use fleetcal_odometry::geometry::wrap_angle_rad;
use fleetcal_odometry::lidar_odometry::{LidarOdometry, OdometryPose, Tracking};
use fleetcal_odometry::{Pose2, RobotTime, Scan};
use nalgebra::Vector3;
use scene::{START, Scanner, Scene, figure_eight, seeded, straight};

/// Result of the odometry for a scan, and the LiDAR's true pose then.
type Pair = (OdometryPose, Pose2);

/// Drives `route` and returns the odometry's results, for the scans that `keep` lets through.
fn drive(
    scene: &Scene,
    scanner: &Scanner,
    route: &dyn Fn(f64) -> Pose2,
    scans: usize,
    seed: u64,
    keep: &dyn Fn(usize) -> bool,
) -> Vec<Pair> {
    let mut rng = seeded(seed);
    let mut odometry = LidarOdometry::default();
    (0..scans)
        .filter(|&index| keep(index))
        .filter_map(|index| {
            let t = index as f64 * scanner.period_s;
            let (scan, truth) = scanner.scan(scene, route, t, &mut rng);
            odometry.process(&scan).map(|pose| (pose, truth))
        })
        .collect()
}

fn drive_all(scene: &Scene, scanner: &Scanner, scans: usize, seed: u64) -> Vec<Pair> {
    drive(scene, scanner, &figure_eight, scans, seed, &|_| true)
}

/// The error of the motion from `from` to `to`, in the LiDAR's frame at `to`.
fn error((from, truth_from): &Pair, (to, truth_to): &Pair) -> Vector3<f64> {
    let estimated = from.lidar_in_odom.between(&to.lidar_in_odom);
    let error = truth_from.between(truth_to).between(&estimated);
    Vector3::new(error.x_m, error.y_m, wrap_angle_rad(error.yaw_rad))
}

/// Root mean square of the errors over `lag` scans: position in mm, yaw in degrees.
fn rms(pairs: &[Pair], lag: usize) -> (f64, f64) {
    let errors: Vec<_> = pairs
        .windows(lag + 1)
        .map(|window| error(&window[0], &window[lag]))
        .collect();
    let mean = |f: &dyn Fn(&Vector3<f64>) -> f64| {
        (errors.iter().map(f).sum::<f64>() / errors.len() as f64).sqrt()
    };
    (
        1e3 * mean(&|e| e.x * e.x + e.y * e.y),
        mean(&|e| e.z * e.z).to_degrees(),
    )
}

fn assert_accurate(pairs: &[Pair], mm: f64, deg: f64) {
    let (position_mm, yaw_deg) = rms(pairs, 10);
    assert!(
        position_mm < mm && yaw_deg < deg,
        "over one second {position_mm:.2} mm and {yaw_deg:.4} deg, accepted {mm} mm and {deg} deg"
    );
}

fn lost_scans(pairs: &[Pair]) -> usize {
    pairs
        .iter()
        .filter(|(pose, _)| pose.tracking == Tracking::Lost)
        .count()
}

#[test]
fn a_second_of_driving_is_known_to_two_millimetres_and_a_hundredth_of_a_degree() {
    let scene = Scene::warehouse().with_people(3, [9.0, 4.0], 3);
    let pairs = drive_all(&scene, &Scanner::default(), 600, 1);
    assert_eq!(pairs.len(), 600);
    assert_eq!(lost_scans(&pairs), 0);
    assert_accurate(&pairs, 1.6, 0.0095);
}

#[test]
fn a_map_that_is_begun_in_a_turn_is_as_true_as_one_begun_at_rest() {
    let scene = Scene::warehouse();
    for moment in 0..30 {
        let begin_s = 5.0 + 1.1 * f64::from(moment);
        let route = move |t: f64| figure_eight(begin_s + t);
        let seed = 100 + moment as u64;
        let pairs = drive(&scene, &Scanner::default(), &route, 60, seed, &|_| true);
        assert_eq!(lost_scans(&pairs), 0, "begun at {begin_s} s");
        for window in pairs.windows(11).step_by(10) {
            let off = error(&window[0], &window[10]);
            let (off_mm, off_deg) = (1e3 * off.xy().norm(), off.z.abs().to_degrees());
            assert!(
                off_mm < 5.0 && off_deg < 0.03,
                "begun at {begin_s} s: {off_mm:.1} mm and {off_deg:.3} deg over one second"
            );
        }
    }
}

#[test]
fn the_covariance_is_as_large_as_the_errors_over_many_seeds() {
    let scene = Scene::warehouse();
    let runs: Vec<_> = (0..8)
        .map(|seed| drive_all(&scene, &Scanner::default(), 330, 40 + seed))
        .collect();
    for lag in [1, 10, 30, 100] {
        let mut sum = 0.0;
        let mut count = 0.0;
        for pairs in &runs {
            for window in pairs[20..].windows(lag + 1).step_by(5) {
                let (from, to) = (&window[0], &window[lag]);
                let motion = from.0.lidar_in_odom.between(&to.0.lidar_in_odom);
                let back = motion.inverse().adjoint();
                let covariance = to.0.covariance + back * from.0.covariance * back.transpose();
                let e = error(from, to);
                sum += (e.transpose() * covariance.try_inverse().unwrap() * e)[0];
                count += 1.0;
            }
        }
        let mean = sum / count;
        assert!(
            (1.6..4.0).contains(&mean),
            "mean normalised error over {lag} scans: got {mean:.2}, expected 3"
        );
    }
}

#[test]
fn sixty_walking_people_neither_pull_the_pose_nor_stay_in_the_map() {
    let scene = Scene::warehouse().with_people(60, [11.0, 7.0], 4);
    let pairs = drive_all(&scene, &Scanner::default(), 600, 1);
    assert_eq!(lost_scans(&pairs), 0);
    assert_accurate(&pairs, 4.0, 0.02);
}

fn assert_reads(scanner: &Scanner, mm: f64, deg: f64) {
    let pairs = drive_all(&Scene::warehouse(), scanner, 250, 1);
    assert_eq!(pairs.len(), 250, "{scanner:?}");
    assert_eq!(lost_scans(&pairs), 0, "{scanner:?}");
    let (position_mm, yaw_deg) = rms(&pairs, 10);
    assert!(
        position_mm < mm && yaw_deg < deg,
        "{position_mm} mm {yaw_deg} deg {scanner:?}"
    );
}

#[test]
fn any_number_of_beams_is_read() {
    for (beams, mm, deg) in [(180, 5.0, 0.03), (360, 3.2, 0.02), (4096, 1.8, 0.01)] {
        assert_reads(
            &Scanner {
                beams,
                ..Scanner::default()
            },
            mm,
            deg,
        );
    }
}

#[test]
fn any_field_of_view_and_direction_is_read() {
    let half_turn = std::f64::consts::PI;
    let narrow = Scanner {
        beams: 512,
        fov_rad: half_turn,
        ..Scanner::default()
    };
    assert_reads(&narrow, 3.0, 0.025);
    let wide = Scanner {
        beams: 811,
        fov_rad: 1.5 * half_turn,
        ..Scanner::default()
    };
    assert_reads(&wide, 2.2, 0.015);
    assert_reads(
        &Scanner {
            clockwise: true,
            ..Scanner::default()
        },
        1.8,
        0.01,
    );
    assert_reads(
        &Scanner {
            rolling: false,
            ..Scanner::default()
        },
        1.8,
        0.01,
    );
}

#[test]
fn dropped_beams_short_sight_and_noise_are_borne() {
    assert_reads(
        &Scanner {
            dropped: 0.3,
            ..Scanner::default()
        },
        2.2,
        0.013,
    );
    assert_reads(
        &Scanner {
            range_max_m: 8.0,
            ..Scanner::default()
        },
        2.4,
        0.018,
    );
    assert_reads(
        &Scanner {
            noise_m: 0.03,
            ..Scanner::default()
        },
        3.2,
        0.02,
    );
}

#[test]
fn ten_missing_scans_do_no_harm() {
    let pairs = drive(
        &Scene::warehouse(),
        &Scanner::default(),
        &figure_eight,
        400,
        1,
        &|index| index % 60 < 50,
    );
    assert_eq!(lost_scans(&pairs), 0);
    let (position_mm, yaw_deg) = rms(&pairs, 1);
    assert!(
        position_mm < 2.0 && yaw_deg < 0.012,
        "{position_mm} mm, {yaw_deg} deg"
    );
}

#[test]
fn a_kidnap_is_said_and_found_back() {
    for seed in 0..6 {
        let kidnap = |t: f64| {
            let pose = figure_eight(t);
            let heading = f64::from(u8::try_from(seed).unwrap());
            let offset = Pose2::new(heading.cos(), heading.sin(), 0.7);
            if t < 15.0 {
                pose
            } else {
                pose.compose(&offset)
            }
        };
        let pairs = drive(
            &Scene::warehouse(),
            &Scanner::default(),
            &kidnap,
            250,
            seed,
            &|_| true,
        );
        let before = &pairs[140];
        let said = pairs[150..]
            .iter()
            .position(|(pose, _)| pose.tracking != Tracking::Tracking);
        assert_eq!(said, Some(0), "said at once, seed {seed}");
        let recovered = pairs
            .iter()
            .position(|(pose, _)| pose.tracking == Tracking::Recovered)
            .unwrap();
        assert!(
            recovered < 160,
            "recovered at scan {recovered}, seed {seed}"
        );
        assert!(
            !pairs[1..].iter().any(|(pose, _)| pose.map_restarted),
            "in its map, seed {seed}"
        );
        for pair in &pairs[recovered..] {
            let e = error(before, pair);
            assert!(
                e.xy().norm() < 0.02 && e.z.abs() < 0.003,
                "{e:?}, seed {seed}"
            );
        }
        for (pose, _) in &pairs[150..recovered] {
            assert_eq!(pose.tracking, Tracking::Lost, "seed {seed}");
            let sigma_m = pose.covariance[(0, 0)].sqrt();
            assert!(
                sigma_m > 0.05,
                "a guess says that it is one: {sigma_m}, seed {seed}"
            );
        }
    }
}

#[test]
fn a_strange_place_gets_a_new_map_after_a_while() {
    let elsewhere = |t: f64| {
        if t < 5.0 {
            figure_eight(t)
        } else {
            Pose2::new(500.0 + t, 0.1, 0.0)
        }
    };
    let mut scene = Scene::warehouse();
    for x in 0..12 {
        let x = 490.0 + 4.0 * f64::from(x);
        scene.add_box(x, 2.0, x + 1.5, 3.0);
        scene.add_box(x + 1.0, -4.0, x + 3.1, -2.5);
    }
    let pairs = drive(&scene, &Scanner::default(), &elsewhere, 120, 1, &|_| true);
    let restart = pairs[1..]
        .iter()
        .position(|(pose, _)| pose.map_restarted)
        .unwrap()
        + 1;
    assert!((51..70).contains(&restart), "{restart}");
    assert!(
        pairs[50..restart]
            .iter()
            .all(|(pose, _)| pose.tracking == Tracking::Lost)
    );
    assert_eq!(lost_scans(&pairs[restart..]), 0);
    assert_accurate(&pairs[restart..], 2.5, 0.02);
}

#[test]
fn a_corridor_leaves_its_axis_open_and_says_so() {
    let pairs = drive(
        &Scene::corridor(),
        &Scanner::default(),
        &straight(0.0),
        100,
        1,
        &|_| true,
    );
    for pair in &pairs[5..] {
        let (pose, truth) = pair;
        let open = pose.unconstrained_rad.expect("the axis is open");
        // The corridor lies along x of the world.
        let off_axis = wrap_angle_rad(2.0 * (open + truth.yaw_rad)) / 2.0;
        assert!(off_axis.abs() < 0.02, "{off_axis}");
        assert_eq!(pose.tracking, Tracking::Degraded);
        let axis = nalgebra::Vector2::new(open.cos(), open.sin());
        let covariance = pose.covariance.fixed_view::<2, 2>(0, 0).into_owned();
        assert!((axis.transpose() * covariance * axis)[0].sqrt() > 0.1);
        let across = nalgebra::Vector2::new(-axis.y, axis.x);
        assert!((across.transpose() * covariance * across)[0].sqrt() < 0.01);
        let e = error(&pairs[0], pair);
        let along_true = truth.yaw_rad;
        let across_error = e.x * along_true.sin() + e.y * along_true.cos();
        assert!(across_error.abs() < 0.02, "{across_error}");
        assert!(e.z.abs() < 0.002);
    }
}

#[test]
fn scans_without_returns_give_no_pose() {
    let shape = ScanShape {
        angle_min_rad: -3.1,
        angle_increment_rad: 0.01,
        time_increment_s: 1e-4,
        range_min_m: 0.1,
        range_max_m: 30.0,
    };
    let mut odometry = LidarOdometry::default();
    for (index, range) in [f32::INFINITY, f32::NAN, 0.0, -1.0, 1e9, 0.05]
        .into_iter()
        .enumerate()
    {
        let stamp = START.plus_seconds(index as f64);
        let scan = Scan::new(stamp, shape, vec![range; 620].into()).unwrap();
        assert!(odometry.process(&scan).is_none(), "{range}");
    }
}

#[test]
fn repeated_scans_are_left_out_and_order_is_kept() {
    let (scene, scanner) = (Scene::warehouse(), Scanner::default());
    let mut rng = seeded(3);
    let mut odometry = LidarOdometry::default();
    let mut last = None;
    for index in 0..120 {
        let (scan, truth) = scanner.scan(&scene, &figure_eight, f64::from(index) * 0.1, &mut rng);
        let pose = odometry.process(&scan).unwrap();
        assert!(odometry.process(&scan).is_none(), "the same stamp again");
        last = Some((scan, (pose, truth)));
    }
    let (scan, _) = last.unwrap();
    let late = Scan::new(
        RobotTime(scan.stamp().0 + 50_000_000),
        *scan.shape(),
        scan.ranges_m().to_vec().into(),
    )
    .unwrap();
    assert!(
        odometry.process(&late).is_none(),
        "the same ranges under a new stamp, on the move"
    );
    let (next, _) = scanner.scan(&scene, &figure_eight, 12.1, &mut rng);
    assert_eq!(
        odometry.process(&next).unwrap().tracking,
        Tracking::Tracking
    );
}

#[test]
fn the_same_scans_give_the_same_bits_and_a_clone_goes_on_alike() {
    let scene = Scene::warehouse().with_people(10, [9.0, 6.0], 5);
    let mut rng = seeded(9);
    let scanner = Scanner::default();
    let scans: Vec<_> = (0..80)
        .map(|index| {
            scanner
                .scan(&scene, &figure_eight, f64::from(index) * 0.1, &mut rng)
                .0
        })
        .collect();
    let mut one = LidarOdometry::default();
    let mut two = LidarOdometry::default();
    for (index, scan) in scans.iter().enumerate() {
        if index == 40 {
            two = one.clone();
        }
        let pose = one.process(scan);
        if index >= 40 {
            assert_eq!(pose, two.process(scan));
        }
    }
    let mut again = LidarOdometry::default();
    let last = scans.iter().map(|scan| again.process(scan)).last();
    let mut once_more = LidarOdometry::default();
    assert_eq!(
        last,
        scans.iter().map(|scan| once_more.process(scan)).last()
    );
}

#[test]
fn memory_stays_within_four_mebibytes_over_ten_kilometres() {
    let scanner = Scanner {
        beams: 180,
        rolling: false,
        ..Scanner::default()
    };
    let route = |t: f64| Pose2::new(4.0 * t, 0.3 * (0.2 * t).sin(), 0.015 * (0.2 * t).cos());
    let mut odometry = LidarOdometry::default();
    let mut rng = seeded(2);
    let mut largest = 0;
    let mut tracked = 0;
    let scans = 25_000;
    for index in 0..scans {
        let t = f64::from(index) * scanner.period_s;
        let (scan, _) = scanner.scan(&aisle_around(route(t).x_m), &route, t, &mut rng);
        if odometry
            .process(&scan)
            .is_some_and(|pose| pose.tracking != Tracking::Lost)
        {
            tracked += 1;
        }
        largest = largest.max(odometry.memory_bytes());
    }
    assert!(largest < 4 << 20, "{largest} bytes");
    assert!(tracked > scans * 99 / 100, "{tracked} of {scans}");
}

#[test]
fn an_odometry_without_a_scan_holds_nothing_of_a_map() {
    let bytes = LidarOdometry::default().memory_bytes();
    assert!(bytes < 1_024, "{bytes} bytes");
}

/// The part in sight of an endless hall with shelves of many kinds.
fn aisle_around(x_m: f64) -> Scene {
    let mut scene = Scene::default();
    scene.walls.push([x_m - 60.0, -14.0, x_m + 60.0, -14.0]);
    scene.walls.push([x_m - 60.0, 12.0, x_m + 60.0, 12.0]);
    let middle = (x_m / 5.0).floor() as i64;
    for shelf in middle - 7..=middle + 7 {
        let x = shelf as f64 * 5.0;
        let kind = (shelf * shelf * 7 + shelf * 3).rem_euclid(11) as f64 * 0.2;
        scene.add_box(x, 2.5 + 0.3 * kind, x + 1.5 + kind, 5.0);
        scene.add_box(x + kind, -7.0, x + 2.0 + kind, -2.6 - 0.2 * kind);
    }
    scene
}
