//! The odometry of a 3D scanner's clouds beside that of a planar one's scans.

#![expect(
    clippy::unwrap_used,
    clippy::expect_used,
    reason = "a test that cannot go on fails"
)]

mod rings;
#[expect(dead_code, reason = "the scene serves other tests too")]
mod scene;

use fleetcal_odometry::geometry::wrap_angle_rad;
use fleetcal_odometry::lidar_odometry::Tracking;
use fleetcal_odometry::point_cloud::PlanarBand;
use fleetcal_odometry::{LidarOdometry, Pose2};
use rings::RingScanner;
use scene::{Scanner, Scene, figure_eight, seeded};

/// Largest difference between two odometries, m and rad, over a drive in which both see the same.
fn apart(planar: Scanner, people: usize) -> (f64, f64) {
    let scene = Scene::warehouse().with_people(people, [9.0, 4.0], 3);
    let rings = RingScanner { planar };
    let (mut of_scans, mut of_clouds) = (LidarOdometry::default(), LidarOdometry::default());
    let (mut scan_noise, mut cloud_noise) = (seeded(1), seeded(2));
    let (mut apart_m, mut apart_rad) = (0.0_f64, 0.0_f64);
    for index in 0..150 {
        let t = f64::from(index) * planar.period_s;
        let (scan, _) = planar.scan(&scene, &figure_eight, t, &mut scan_noise);
        let (cloud, _) = rings.cloud(&scene, &figure_eight, t, &mut cloud_noise);
        let flat = PlanarBand::default().scan(&cloud).expect("a turn");
        let [by_scan, by_cloud]: [Pose2; 2] = [(&mut of_scans, &scan), (&mut of_clouds, &flat)]
            .map(|(odometry, scan)| {
                let pose = odometry.process(scan).expect("a pose");
                assert_ne!(pose.tracking, Tracking::Lost, "scan {index}");
                pose.lidar_in_odom
            });
        let off = by_scan.between(&by_cloud);
        apart_m = apart_m.max(off.translation().norm());
        apart_rad = apart_rad.max(wrap_angle_rad(off.yaw_rad).abs());
    }
    (apart_m, apart_rad)
}

#[test]
fn a_cloud_of_32_rings_gives_the_odometry_of_a_planar_scan() {
    for (planar, people) in [
        (Scanner::default(), 5),
        (
            Scanner {
                beams: 720,
                clockwise: true,
                dropped: 0.1,
                ..Scanner::default()
            },
            0,
        ),
        (
            Scanner {
                rolling: false,
                ..Scanner::default()
            },
            0,
        ),
    ] {
        let (apart_m, apart_rad) = apart(planar, people);
        assert!(
            apart_m < 0.01 && apart_rad < 0.1_f64.to_radians(),
            "{apart_m} m and {apart_rad} rad apart, {planar:?}"
        );
    }
}
