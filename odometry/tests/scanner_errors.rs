//! Systematic errors of a scanner: its ranges, and the times of its beams.

#[expect(dead_code, reason = "the scene serves other tests too")]
mod scene;

use std::f64::consts::TAU;

use fleetcal_odometry::Pose2;
use fleetcal_odometry::geometry::wrap_angle_rad;
use fleetcal_odometry::lidar_odometry::{
    BeamTimes, LidarOdometry, MisledBy, OdometryPose, ScannerReport, Tracking,
};
use nalgebra::Vector3;
use scene::{Scanner, Scene, figure_eight, seeded};

/// Result of the odometry for a scan, and the LiDAR's true pose then.
type Pair = (OdometryPose, Pose2);

/// Seconds after which the scanner should be known.
const LEARNT_S: f64 = 25.0;
/// Seconds of a drive: three figures of eight.
const DRIVE_S: f64 = 100.0;

fn drive(scanner: &Scanner, seed: u64) -> (Vec<Pair>, LidarOdometry) {
    let mut rng = seeded(seed);
    let scene = Scene::warehouse();
    let mut odometry = LidarOdometry::default();
    let scans = (DRIVE_S / scanner.period_s) as usize;
    let pairs = (0..scans)
        .filter_map(|index| {
            let t = index as f64 * scanner.period_s;
            let (scan, truth) = scanner.scan(&scene, &figure_eight, t, &mut rng);
            odometry.process(&scan).map(|pose| (pose, truth))
        })
        .collect();
    (pairs, odometry)
}

/// Mean error of the motion over a second, by the direction of the turn: to the left, to the right.
/// In mm, mm and degrees, in the LiDAR's frame at the end.
fn mean_errors(scanner: &Scanner, pairs: &[Pair]) -> [Vector3<f64>; 2] {
    let lag = (1.0 / scanner.period_s).round() as usize;
    let from = (LEARNT_S / scanner.period_s) as usize;
    let mut sums = [(Vector3::zeros(), 0.0); 2];
    for pair in pairs[from..].windows(lag + 1) {
        let ((from, truth_from), (to, truth_to)) = (&pair[0], &pair[lag]);
        if pair[1..].iter().any(|(pose, _)| pose.map_restarted) {
            continue;
        }
        let truth = truth_from.between(truth_to);
        let estimated = from.lidar_in_odom.between(&to.lidar_in_odom);
        let error = truth.between(&estimated);
        let error = Vector3::new(
            1e3 * error.x_m,
            1e3 * error.y_m,
            wrap_angle_rad(error.yaw_rad).to_degrees(),
        );
        let turn_rad = wrap_angle_rad(truth.yaw_rad);
        if turn_rad.abs() > 0.15 {
            let side = usize::from(turn_rad < 0.0);
            sums[side].0 += error;
            sums[side].1 += 1.0;
        }
    }
    sums.map(|(sum, count)| sum / count)
}

/// Asserts that no second of a turn is wrong by this on the mean.
fn assert_unbiased(scanner: &Scanner, seed: u64, mm: f64, deg: f64) -> ScannerReport {
    let (pairs, odometry) = drive(scanner, seed);
    let lost = |(pose, _): &&Pair| pose.tracking == Tracking::Lost;
    assert_eq!(pairs.iter().filter(lost).count(), 0, "{scanner:?}");
    let [left, right] = mean_errors(scanner, &pairs);
    let report = odometry.scanner();
    for error in [left, right] {
        assert!(
            error.xy().amax() < mm && error.z.abs() < deg,
            "left {left:?}, right {right:?}, accepted {mm} mm and {deg} deg: {scanner:?}"
        );
    }
    report
}

#[test]
fn a_range_bias_is_learnt_and_does_not_bend_the_turns() {
    for range_bias_m in [0.0, 0.03, -0.03] {
        let scanner = Scanner {
            range_bias_m,
            ..Scanner::default()
        };
        let (learnt_m, _) = assert_unbiased(&scanner, 1, 0.2, 0.003).range_bias_m;
        let off_m = learnt_m - range_bias_m;
        assert!(
            off_m.abs() < 0.004,
            "{learnt_m} m, {range_bias_m} m is right"
        );
    }
}

#[test]
fn a_bias_by_incidence_is_learnt_and_does_not_bend_the_turns() {
    for incidence_bias_m in [0.02, 0.06] {
        let scanner = Scanner {
            incidence_bias_m,
            ..Scanner::default()
        };
        assert_unbiased(&scanner, 1, 0.2, 0.003);
    }
}

fn untimed(rate_hz: f64) -> Scanner {
    Scanner {
        untimed: true,
        beams: 720,
        period_s: rate_hz.recip(),
        ..Scanner::default()
    }
}

#[test]
fn a_turning_scanner_that_tells_no_times_is_seen_to_turn() {
    for rate_hz in [40.0, 10.0, 5.0] {
        let scanner = untimed(rate_hz);
        let BeamTimes::Turning { duration_s, .. } =
            assert_unbiased(&scanner, 1, 0.2, 0.003).beam_times
        else {
            panic!("taken for a scanner that does not turn: {scanner:?}");
        };
        let off_s = duration_s - scanner.period_s;
        assert!(
            off_s.abs() < 0.02 * scanner.period_s,
            "{duration_s} s: {scanner:?}"
        );
    }
}

/// Scanners without beam times that see the floor, each with the seed of its drive.
fn untimed_and_tilted() -> [(Scanner, u64); 5] {
    [
        (5.0, 1.0_f64, 2.4, 1),
        (5.0, 1.0, 2.4, 2),
        (5.0, 1.4, -1.2, 1),
        (5.0, 1.4, -1.2, 2),
        (5.5, 1.4, -2.5, 2),
    ]
    .map(|(rate_hz, tilt_deg, tilt_direction_rad, seed)| {
        let scanner = Scanner {
            tilt_rad: tilt_deg.to_radians(),
            tilt_direction_rad,
            uneven_m: 0.001,
            pitch_rad: 0.02_f64.to_radians(),
            range_bias_m: -0.015,
            ..untimed(rate_hz)
        };
        (scanner, seed)
    })
}

fn times_misled_by_beam_times(poses: &[Pair]) -> usize {
    let is_told = |(pose, _): &&Pair| pose.misled_by == Some(MisledBy::BeamTimes);
    poses.iter().filter(is_told).count()
}

/// Scanners whose floor's returns show a wrong duration until the floor is found, and whose map,
/// drawn with it, hides most of the right one: they were judged not to turn, for good.
#[test]
fn a_turning_scanner_that_sees_the_floor_is_seen_to_turn_after_all() {
    for (scanner, seed) in untimed_and_tilted() {
        let (poses, odometry) = drive(&scanner, seed);
        let report = odometry.scanner();
        let BeamTimes::Turning { duration_s, .. } = report.beam_times else {
            panic!("taken for a scanner that does not turn: {scanner:?}, {report:?}");
        };
        let off_s = duration_s - scanner.period_s;
        assert!(off_s.abs() < 0.02 * scanner.period_s, "{duration_s} s");
        assert_eq!(times_misled_by_beam_times(&poses), 1, "{scanner:?}");
    }
}

#[test]
fn a_scanner_that_takes_all_beams_at_once_and_sees_the_floor_is_left_alone() {
    for (turning, seed) in untimed_and_tilted() {
        let scanner = Scanner {
            rolling: false,
            ..turning
        };
        let (poses, odometry) = drive(&scanner, seed);
        let beam_times = odometry.scanner().beam_times;
        assert_eq!(beam_times, BeamTimes::AtOnce, "{scanner:?}");
        assert_eq!(times_misled_by_beam_times(&poses), 0, "{scanner:?}");
    }
}

#[test]
fn a_scanner_that_takes_all_beams_at_once_is_left_alone() {
    for rate_hz in [40.0, 10.0] {
        let scanner = Scanner {
            rolling: false,
            ..untimed(rate_hz)
        };
        let report = assert_unbiased(&scanner, 1, 0.2, 0.003);
        assert_eq!(report.beam_times, BeamTimes::AtOnce, "{scanner:?}");
    }
}

#[test]
fn a_part_of_a_turn_takes_its_part_of_the_time() {
    let scanner = Scanner {
        fov_rad: 0.75 * TAU,
        clockwise: true,
        ..untimed(25.0)
    };
    let report = assert_unbiased(&scanner, 1, 0.2, 0.003);
    assert!(
        matches!(report.beam_times, BeamTimes::Turning { .. }),
        "{report:?}"
    );
}

/// Tilts by one degree towards each side in turn, over a floor that is uneven by a millimetre, on a robot
/// that pitches by 0.02 degrees: the floor's line moves to and fro by 30 cm where it is seen 11 m ahead.
#[test]
fn a_tilted_scanner_sees_the_floor_and_leaves_it_out() {
    for tilt_direction_rad in [0.0, 1.0, -1.2, 2.0, -2.5] {
        let scanner = Scanner {
            tilt_rad: 1_f64.to_radians(),
            tilt_direction_rad,
            uneven_m: 0.001,
            pitch_rad: 0.02_f64.to_radians(),
            ..Scanner::default()
        };
        let report = assert_unbiased(&scanner, 1, 0.3, 0.005);
        let floor = report.floor.unwrap();
        let (off_m, off_rad) = (
            floor.distance_m() - 0.2 / scanner.tilt_rad.sin(),
            wrap_angle_rad(floor.direction_rad() - tilt_direction_rad),
        );
        assert!(off_m.abs() < 0.3 && off_rad.abs() < 0.02, "{floor:?}");
    }
}
