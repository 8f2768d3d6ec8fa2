//! Beams and scans.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use super::{poses, quiet, quiet_scans, run, scans, still, with};
use crate::simulator::{
    Area, ImperfectionKind, Imperfections, LidarImperfections, Point, Scan, ScannerImperfections,
    SimulationConfig, World,
};

fn scanner(imperfections: ScannerImperfections) -> Imperfections {
    Imperfections {
        scanner: imperfections,
        ..Imperfections::default()
    }
}

/// Returns the last scan of a drive of some seconds.
fn last_scan(config: SimulationConfig) -> Scan {
    let messages = run(config, 12.0);
    scans(&messages).last().unwrap().0.clone()
}

/// Makes a robot at rest in the middle of a room of 20 m by 8 m, its LiDAR there and looking along
/// x.
fn room() -> SimulationConfig {
    let mut config = still(quiet_scans());
    let sides = Area::around(Point::default(), 20.0, 8.0).sides().to_vec();
    config.world = Arc::new(World::new(sides, Vec::new(), Vec::new()));
    config.route = crate::simulator::Route::straight(Point::new(-0.434, 0.0), Point::new(9.0, 0.0));
    config
}

/// Returns the range to the room's walls and the cosine of the incidence, by a beam's angle.
fn room_range(angle_rad: f64) -> (f64, f64) {
    let (sin, cos) = angle_rad.sin_cos();
    let (end_m, side_m) = (10.0 / cos.abs(), 4.0 / sin.abs());
    if end_m < side_m {
        (end_m, cos.abs())
    } else {
        (side_m, sin.abs())
    }
}

fn angles(scan: &Scan) -> impl Iterator<Item = (f64, f64)> {
    scan.ranges_m.iter().enumerate().map(|(beam, range_m)| {
        let angle_rad = scan.angle_min_rad + beam as f64 * scan.angle_increment_rad;
        (angle_rad, f64::from(*range_m))
    })
}

#[test]
fn ranges_are_scaled_and_biased_and_more_so_at_a_grazing_angle() {
    let imperfections = Imperfections {
        lidar: LidarImperfections {
            range_scale: 0.005,
            ..LidarImperfections::default()
        },
        scanner: ScannerImperfections {
            range_bias_m: -0.03,
            incidence_bias_m: 0.01,
            ..ScannerImperfections::default()
        },
        ..Imperfections::default()
    };
    let scan = last_scan(with(room(), imperfections));
    for (angle_rad, range_m) in angles(&scan) {
        let (true_m, cos) = room_range(angle_rad);
        let expected_m = 1.005 * true_m - 0.03 + 0.01 * (1.0 - cos) / 0.5;
        assert!(
            (range_m - expected_m).abs() < 1e-5,
            "{angle_rad}: {range_m} {expected_m}"
        );
    }
}

#[test]
fn a_scanner_without_beam_times_sends_the_ranges_of_one_that_has_them() {
    let plain = last_scan(quiet_scans());
    let untimed = last_scan(with(
        quiet_scans(),
        Imperfections::typical(ImperfectionKind::Untimed10Hz),
    ));
    assert!(plain.time_increment_s > 0.0);
    assert!(untimed.time_increment_s.abs() < f64::MIN_POSITIVE);
    assert_eq!(
        (plain.stamp_ns, &plain.ranges_m),
        (untimed.stamp_ns, &untimed.ranges_m)
    );
    let faster = last_scan(with(
        quiet_scans(),
        Imperfections::typical(ImperfectionKind::Untimed40Hz),
    ));
    assert!((faster.scan_time_s - 0.025).abs() < 1e-12);
}

#[test]
fn a_scan_stamped_at_its_end_is_the_same_scan_later() {
    let plain = last_scan(quiet_scans());
    let late = last_scan(with(
        quiet_scans(),
        Imperfections::typical(ImperfectionKind::StampedAtEnd),
    ));
    assert_eq!(plain.ranges_m, late.ranges_m);
    assert_eq!(late.stamp_ns - plain.stamp_ns, 100_000_000);
}

#[test]
fn the_scan_rate_is_that_of_the_imperfection_for_scans_and_poses() {
    for (rate_hz, kind) in [
        (5, ImperfectionKind::ScanRate5Hz),
        (40, ImperfectionKind::ScanRate40Hz),
    ] {
        let messages = run(with(quiet_scans(), Imperfections::typical(kind)), 10.0);
        let seen = scans(&messages).len();
        assert!((10 * rate_hz - 1..=10 * rate_hz).contains(&seen), "{seen}");
        let messages = run(with(quiet(), Imperfections::typical(kind)), 10.0);
        let seen = poses(&messages).len();
        assert!((10 * rate_hz - 3..=10 * rate_hz).contains(&seen), "{seen}");
    }
}

#[test]
fn poses_of_a_scaled_range_are_farther_apart_and_turn_the_same() {
    let imperfections = Imperfections::typical(ImperfectionKind::RangeScale);
    let (plain, scaled) = (run(quiet(), 30.0), run(with(quiet(), imperfections), 30.0));
    for ((plain, _), (scaled, _)) in poses(&plain).iter().zip(poses(&scaled)) {
        assert!((scaled.pose.x_m - 1.005 * plain.pose.x_m).abs() < 1e-9);
        assert!((scaled.pose.y_m - 1.005 * plain.pose.y_m).abs() < 1e-9);
        assert!((scaled.pose.yaw_rad - plain.pose.yaw_rad).abs() < 1e-12);
    }
}

#[test]
fn mixed_pixels_lie_between_the_two_surfaces_of_an_edge() {
    let plain = last_scan(quiet_scans());
    let mixed = last_scan(with(
        quiet_scans(),
        scanner(ScannerImperfections {
            mixed_pixels: 0.5,
            ..ScannerImperfections::default()
        }),
    ));
    let (mut edges, mut changed) = (0, 0);
    for (pair, now_m) in plain.ranges_m.windows(2).zip(&mixed.ranges_m) {
        let (near_m, far_m) = (pair[0].min(pair[1]), pair[0].max(pair[1]));
        let edge = far_m - near_m > 0.15;
        edges += usize::from(edge);
        if (now_m - pair[0]).abs() > 1e-6 {
            changed += 1;
            assert!(edge && (near_m..=far_m).contains(now_m), "{pair:?} {now_m}");
        }
    }
    let share = f64::from(changed) / edges as f64;
    assert!(
        edges > 30 && (share - 0.5).abs() < 0.25,
        "{changed} of {edges}"
    );
}

#[test]
fn a_tilted_scanner_meets_the_floor_ahead_and_higher_walls_behind() {
    let tilt_rad = 2_f64.to_radians();
    for direction_rad in [0.0, 1.0] {
        let scan = last_scan(with(
            room(),
            scanner(ScannerImperfections {
                tilt_rad,
                tilt_direction_rad: direction_rad,
                ..ScannerImperfections::default()
            }),
        ));
        let mut floor = 0;
        for (angle_rad, range_m) in angles(&scan) {
            // The point in the LiDAR's frame, then in the level one: its height tells what it is on.
            let along_m = range_m * (angle_rad - direction_rad).cos();
            let across_m = range_m * (angle_rad - direction_rad).sin();
            let down_m = along_m * tilt_rad.sin();
            let level_m = along_m * tilt_rad.cos();
            let (sin, cos) = f64::sin_cos(direction_rad);
            let (x_m, y_m) = (
                cos * level_m - sin * across_m,
                sin * level_m + cos * across_m,
            );
            if (down_m - 0.2).abs() < 1e-5 {
                floor += 1;
                assert!(x_m.abs() < 10.0 + 1e-4 && y_m.abs() < 4.0 + 1e-4);
            } else {
                assert!(down_m < 0.2);
                let off_m = (x_m.abs() - 10.0).abs().min((y_m.abs() - 4.0).abs());
                assert!(off_m < 1e-4, "{angle_rad}: {x_m} {y_m}");
            }
        }
        assert!(floor > 10, "{floor} beams meet the floor");
    }
}

#[test]
fn a_drawn_tilt_points_anywhere() {
    let directions: Vec<_> = (0..40)
        .map(|seed| {
            let drawn = Imperfections::drawn(
                ImperfectionKind::Tilt,
                crate::simulator::Strength::Typical,
                seed,
            );
            drawn.scanner.tilt_direction_rad
        })
        .collect();
    let in_quarter = |n: i32| {
        let from = -PI + f64::from(n) * TAU / 4.0;
        directions
            .iter()
            .any(|rad| (from..from + TAU / 4.0).contains(rad))
    };
    assert!((0..4).all(in_quarter));
}
