//! The floor that a tilted scanner sees: its returns, and those that are not.

mod scene;

use fleetcal_odometry::lidar_odometry::{FloorLine, LidarOdometry, MisledBy};
use fleetcal_odometry::{Pose2, Scan};
use scene::{Scanner, Scene, figure_eight, seeded, straight};
use std::f64::consts::TAU;

/// Pose of a LiDAR at a time, s.
type Route = dyn Fn(f64) -> Pose2;

/// Scans of a minute and a half.
const SCANS: u32 = 900;

/// A scanner tilted straight ahead, by so many degrees.
fn tilted(degrees: f64) -> Scanner {
    Scanner {
        tilt_rad: degrees.to_radians(),
        ..Scanner::default()
    }
}

/// Distance of the floor's line of a scanner tilted by so many degrees, m.
fn floor_m(degrees: f64) -> f64 {
    0.2 / degrees.to_radians().sin()
}

fn is_at(floor: Option<FloorLine>, distance_m: f64) -> bool {
    floor.is_some_and(|floor| (floor.distance_m() - distance_m).abs() < 0.02 * distance_m)
}

/// Passes the scans of these numbers to an odometry; returns how often it reported the floor as
/// found.
fn follow(
    odometry: &mut LidarOdometry,
    scanner: &Scanner,
    scene: &Scene,
    route: &Route,
    scans: std::ops::Range<u32>,
) -> usize {
    let mut rng = seeded(u64::from(scans.start));
    let mut found = 0;
    for index in scans {
        let t = scanner.period_s * f64::from(index);
        let (scan, _) = scanner.scan(scene, route, t, &mut rng);
        let pose = odometry.process(&scan);
        found += usize::from(pose.is_some_and(|pose| pose.misled_by == Some(MisledBy::Floor)));
    }
    found
}

/// Follows an upright scanner, and returns how far it turned in all, rad.
fn assert_sees_no_floor(scene: &Scene, route: &Route, scan_of: &dyn Fn(Scan) -> Scan) -> f64 {
    let (mut rng, scanner) = (seeded(1), Scanner::default());
    let mut odometry = LidarOdometry::default();
    let (mut turned_rad, mut last) = (0.0, None);
    for index in 0..SCANS {
        let t = 0.1 * f64::from(index);
        let (scan, _) = scanner.scan(scene, route, t, &mut rng);
        if let Some(pose) = odometry.process(&scan_of(scan)) {
            let now = pose.lidar_in_odom;
            let before = last.replace(now).unwrap_or(now);
            turned_rad += before.between(&now).log().z.abs();
        }
        assert_eq!(odometry.scanner().floor, None, "after {t} s");
    }
    turned_rad
}

#[test]
fn no_scanner_that_is_upright_sees_the_floor() {
    let as_it_is = |scan: Scan| scan;
    assert_sees_no_floor(&Scene::corridor(), &straight(-30.0), &as_it_is);
    assert_sees_no_floor(&Scene::warehouse(), &figure_eight, &as_it_is);
    let crowded = Scene::warehouse().with_people(8, [9.0, 6.0], 3);
    assert_sees_no_floor(&crowded, &figure_eight, &as_it_is);
}

/// A wall that bends around the robot, with a few posts by which the odometry sees it turn, and the walls of
/// a square hall around a robot that circles.
#[test]
fn a_hall_that_turns_around_the_robot_is_no_floor() {
    let as_it_is = |scan: Scan| scan;
    let mut round = Scene::default();
    let corners: Vec<_> = (0..=64).map(|i| f64::from(i) / 64.0 * TAU).collect();
    for pair in corners.windows(2) {
        let [(y0, x0), (y1, x1)] = [pair[0], pair[1]].map(f64::sin_cos);
        round.walls.push([8.0 * x0, 8.0 * y0, 8.0 * x1, 8.0 * y1]);
    }
    round.poles = vec![
        [3.0, 1.0, 0.2],
        [-2.0, 3.0, 0.2],
        [1.0, -4.0, 0.2],
        [-4.0, -2.0, 0.2],
    ];
    let on_the_spot = |t: f64| Pose2::new(0.0, 0.0, 0.4 * t);
    let turned_rad = assert_sees_no_floor(&round, &on_the_spot, &as_it_is);
    assert!(turned_rad > 30.0, "{turned_rad} rad of 36");

    let mut hall = Scene::default();
    hall.add_box(-10.0, -10.0, 10.0, 10.0);
    let circle = |t: f64| {
        let (s, c) = (0.3 * t).sin_cos();
        Pose2::new(3.0 * c, 3.0 * s, 0.3 * t + 0.25 * TAU)
    };
    let turned_rad = assert_sees_no_floor(&hall, &circle, &as_it_is);
    assert!(turned_rad > 25.0, "{turned_rad} rad of 27");
}

/// The back of a truck 2.5 m ahead that drives as the robot does, where everything behind it is out
/// of reach.
#[test]
fn a_vehicle_ahead_at_the_same_speed_is_no_floor() {
    let behind_truck = |scan: Scan| {
        let shape = *scan.shape();
        let ranges: Vec<f32> = scan
            .ranges_m()
            .iter()
            .enumerate()
            .map(|(beam, range_m)| {
                let angle_rad = shape.angle_min_rad + beam as f64 * shape.angle_increment_rad;
                let back_m = 2.5 / angle_rad.cos();
                if angle_rad.tan().abs() < 0.16 && angle_rad.cos() > 0.0 && back_m < 1e9 {
                    back_m as f32
                } else if angle_rad.cos() > 0.3 {
                    f32::INFINITY
                } else {
                    *range_m
                }
            })
            .collect();
        Scan::new(scan.stamp(), shape, ranges.into()).unwrap()
    };
    assert_sees_no_floor(&Scene::warehouse(), &figure_eight, &behind_truck);
}

#[test]
fn the_line_is_forgotten_when_the_scanner_is_levelled_and_sought_anew_when_it_tilts_more() {
    let scene = Scene::warehouse();
    let mut odometry = LidarOdometry::default();
    let mut drive = |scanner: &Scanner, scans| {
        let found = follow(&mut odometry, scanner, &scene, &figure_eight, scans);
        (found, odometry.scanner().floor)
    };
    let (found, floor) = drive(&tilted(1.0), 0..SCANS);
    assert!(found == 1 && is_at(floor, floor_m(1.0)), "{floor:?}");
    let (found, floor) = drive(&tilted(2.0), SCANS..2 * SCANS);
    assert!(found == 0 && is_at(floor, floor_m(2.0)), "{floor:?}");
    let (found, floor) = drive(&tilted(0.0), 2 * SCANS..3 * SCANS);
    assert!(found == 0 && floor.is_none(), "{floor:?}");
    // What was learnt was misled once; to see the floor again does not take it away again.
    let (found, floor) = drive(&tilted(1.0), 3 * SCANS..4 * SCANS);
    assert!(found == 0 && is_at(floor, floor_m(1.0)), "{floor:?}");
}

#[test]
fn what_was_learnt_of_the_floor_is_kept_with_the_scanner() {
    let scene = Scene::warehouse();
    let mut odometry = LidarOdometry::default();
    follow(&mut odometry, &tilted(1.0), &scene, &figure_eight, 0..SCANS);
    let stored = serde_json::to_string(&odometry.learnt_scanner()).unwrap();
    let mut next = LidarOdometry::default().with_scanner(serde_json::from_str(&stored).unwrap());
    assert_eq!(next.scanner().floor, odometry.scanner().floor);
    let scans = SCANS..SCANS + 100;
    let found = follow(&mut next, &tilted(1.0), &scene, &figure_eight, scans);
    assert_eq!(found, 0);
    // Without the line, as estimators before this one stored it.
    let mut older: serde_json::Value = serde_json::from_str(&stored).unwrap();
    older.as_object_mut().unwrap().remove("floor");
    let older = LidarOdometry::default().with_scanner(serde_json::from_value(older).unwrap());
    assert_eq!(older.scanner().floor, None);
}

/// A driver that sends another number of beams from scan to scan.
#[test]
fn scans_of_other_beams_are_not_compared() {
    let scene = Scene::warehouse();
    let (mut rng, mut odometry) = (seeded(1), LidarOdometry::default());
    for index in 0..SCANS {
        let scanner = Scanner {
            beams: 720 + index as usize % 2,
            ..Scanner::default()
        };
        let t = 0.1 * f64::from(index);
        let (scan, _) = scanner.scan(&scene, &figure_eight, t, &mut rng);
        odometry.process(&scan);
        assert_eq!(odometry.scanner().floor, None, "after {t} s");
    }
}
