//! LiDAR odometry in a map that was made before: the simulated warehouse, drawn as a grid.
#![expect(clippy::unwrap_used, reason = "a drive that cannot be ends its test")]

use std::f64::consts::PI;
use std::sync::Arc;

use fleetcal_odometry::ScanShape;
use fleetcal_odometry::geometry::wrap_angle_rad;
use fleetcal_odometry::lidar_odometry::{OdometryPose, Tracking};
use fleetcal_odometry::occupancy_grid::Occupancy;
use fleetcal_odometry::{LidarOdometry, OccupancyGrid, Pose2, RobotTime, Scan};
use fleetcal_robot::simulator::{SimulatedMessage, Simulation, SimulationConfig, World};
use nalgebra::{Vector2, Vector3};

/// Draws a world's walls and pillars into cells of `resolution_m`, the first corner at `origin`:
/// the space that can be reached from `start` is free, the rest unknown.
fn drawn(world: &World, resolution_m: f64, origin: Pose2, start: Pose2) -> OccupancyGrid {
    let into_grid = origin.inverse();
    let corners = world.segments().iter().flat_map(|s| [s.from, s.to]);
    let far = corners
        .map(|p| into_grid.transform_point(Vector2::new(p.x_m, p.y_m)))
        .fold(Vector2::zeros(), |far: Vector2<f64>, p| far.sup(&p));
    let count = |metres: f64| (metres / resolution_m).ceil() as usize + 2;
    let (width, height) = (count(far.x), count(far.y));
    let mut cells = vec![Occupancy::Unknown; width * height];
    let index_of = |x_m: f64, y_m: f64| {
        let point = into_grid.transform_point(Vector2::new(x_m, y_m)) / resolution_m;
        let inside = |v: f64, count: usize| v >= 0.0 && v < count as f64;
        assert!(
            inside(point.x, width) && inside(point.y, height),
            "{x_m} {y_m}"
        );
        point.y as usize * width + point.x as usize
    };
    for segment in world.segments() {
        let parts = (segment.from.distance_m(segment.to) / resolution_m * 20.0).ceil();
        for part in 0..=parts as usize {
            let point = segment.from.toward(segment.to, part as f64 / parts);
            cells[index_of(point.x_m, point.y_m)] = Occupancy::Occupied;
        }
    }
    for pillar in world.pillars() {
        for part in 0..400 {
            let (s, c) = (f64::from(part) * PI / 200.0).sin_cos();
            let (x, y) = (
                pillar.centre.x_m + pillar.radius_m * c,
                pillar.centre.y_m + pillar.radius_m * s,
            );
            cells[index_of(x, y)] = Occupancy::Occupied;
        }
    }
    let mut open = vec![index_of(start.x_m, start.y_m)];
    while let Some(index) = open.pop() {
        if cells[index] == Occupancy::Unknown {
            cells[index] = Occupancy::Free;
            open.extend([index - 1, index + 1, index - width, index + width]);
        }
    }
    OccupancyGrid::new(resolution_m, origin, width, cells).unwrap()
}

struct Drive {
    scans: Vec<(Scan, Pose2)>,
    world: Arc<World>,
}

fn simulated(people: usize, seed: u64, scans: usize) -> Drive {
    let mut config = SimulationConfig::figure_eight(seed);
    config.people.count = people;
    let world = Arc::clone(&config.world);
    let mut simulation = Simulation::new(config).unwrap();
    let mut taken = Vec::new();
    while taken.len() < scans {
        let emitted = simulation.advance();
        if let SimulatedMessage::Scan(scan) = emitted.message {
            let shape = ScanShape {
                angle_min_rad: scan.angle_min_rad,
                angle_increment_rad: scan.angle_increment_rad,
                time_increment_s: scan.time_increment_s,
                range_min_m: scan.range_min_m,
                range_max_m: scan.range_max_m,
            };
            let truth = emitted.truth.lidar;
            let truth = Pose2::new(truth.x_m, truth.y_m, truth.yaw_rad);
            let scan = Scan::new(RobotTime(scan.stamp_ns), shape, scan.ranges_m.into()).unwrap();
            taken.push((scan, truth));
        }
    }
    Drive {
        scans: taken,
        world,
    }
}

fn error(pose: &OdometryPose, truth: &Pose2) -> Vector3<f64> {
    let error = truth.between(&pose.lidar_in_odom);
    Vector3::new(error.x_m, error.y_m, wrap_angle_rad(error.yaw_rad))
}

/// Result of the odometry for each scan, with its error.
fn driven(odometry: &mut LidarOdometry, drive: &Drive) -> Vec<(OdometryPose, Vector3<f64>)> {
    let poses = drive.scans.iter().map(|(scan, truth)| {
        let pose = odometry.process(scan).unwrap();
        let error = error(&pose, truth);
        (pose, error)
    });
    poses.collect()
}

/// Root mean square and largest error of the position, m, and largest of the yaw, rad.
fn errors(driven: &[(OdometryPose, Vector3<f64>)]) -> (f64, f64, f64) {
    let squares = driven.iter().map(|(_, e)| e.xy().norm_squared());
    let largest =
        |f: &dyn Fn(&Vector3<f64>) -> f64| driven.iter().map(|(_, e)| f(e)).fold(0.0, f64::max);
    let rms_m = (squares.sum::<f64>() / driven.len() as f64).sqrt();
    (rms_m, largest(&|e| e.xy().norm()), largest(&|e| e.z.abs()))
}

/// Grid on whose axes walls lie in the middle of cells of 5 cm.
const ALONG_AXES: Pose2 = Pose2::new(-20.525, -12.525, 0.0);
/// Grid in which walls lie anywhere in their cells.
const ASKEW: Pose2 = Pose2::new(-20.4, -12.7, 0.012);

#[test]
fn in_a_known_map_the_pose_stays_true_among_people() {
    for (people, seed) in [(3, 1), (20, 2), (60, 3)] {
        let drive = simulated(people, seed, 400);
        let start = drive.scans[0].1;
        for origin in [ALONG_AXES, ASKEW] {
            let grid = drawn(&drive.world, 0.05, origin, start);
            let driven = driven(&mut LidarOdometry::with_map(&grid, start).unwrap(), &drive);
            let (rms_m, largest_m, yaw_rad) = errors(&driven);
            assert!(
                rms_m < 0.004 && largest_m < 0.02,
                "{rms_m} {largest_m} {people} people"
            );
            assert!(yaw_rad < 0.1_f64.to_radians(), "{yaw_rad}");
            for (pose, _) in &driven {
                assert!(
                    matches!(pose.tracking, Tracking::Tracking | Tracking::Degraded),
                    "{pose:?}"
                );
                assert!(!pose.map_restarted);
            }
        }
    }
}

#[test]
fn a_grid_is_off_by_no_more_than_half_its_cells() {
    let drive = simulated(3, 4, 150);
    let start = drive.scans[0].1;
    // The hall's walls lie on the cells' edges, the worst that can be.
    let origin = Pose2::new(-20.5, -12.5, 0.0);
    for resolution_m in [0.025, 0.05, 0.1] {
        let grid = drawn(&drive.world, resolution_m, origin, start);
        let driven = driven(&mut LidarOdometry::with_map(&grid, start).unwrap(), &drive);
        let (rms_m, largest_m, _) = errors(&driven);
        let half_m = 0.5 * resolution_m * 2.0_f64.sqrt();
        assert!(
            largest_m < half_m + 0.01,
            "{largest_m} of cells of {resolution_m}"
        );
        let jitter_m = driven
            .iter()
            .map(|(_, e)| (e.xy().norm() - rms_m).powi(2))
            .sum::<f64>();
        let jitter_m = (jitter_m / driven.len() as f64).sqrt();
        assert!(
            jitter_m < 0.004 + 0.05 * resolution_m,
            "{jitter_m} of cells of {resolution_m}"
        );
    }
}

#[test]
fn a_wrong_start_is_said_and_the_place_found_by_search() {
    let drive = simulated(20, 5, 60);
    let truth = drive.scans[0].1;
    let grid = drawn(&drive.world, 0.05, ALONG_AXES, truth);
    for (x_m, y_m, yaw_rad, scans_max) in [
        (0.2, -0.2, 0.2, 0),
        (-1.0, 0.4, -0.7, 3),
        (1.5, 2.0, 3.0, 3),
        (-5.0, 3.0, 1.5, 15),
    ] {
        let start = truth.compose(&Pose2::new(x_m, y_m, yaw_rad));
        let driven = driven(&mut LidarOdometry::with_map(&grid, start).unwrap(), &drive);
        let found = driven
            .iter()
            .position(|(pose, _)| pose.tracking != Tracking::Lost)
            .unwrap();
        assert!(found <= scans_max, "{found} from {start:?}");
        if found > 0 {
            assert_eq!(driven[found].0.tracking, Tracking::Recovered);
            let guess = &driven[0].0;
            assert!(
                guess.covariance[(0, 0)].sqrt() > 0.5,
                "a guess says that it is one"
            );
        }
        let (_, largest_m, yaw_rad) = errors(&driven[found..]);
        assert!(
            largest_m < 0.02 && yaw_rad < 0.002,
            "{largest_m} {yaw_rad} from {start:?}"
        );
    }
}

#[test]
fn outside_its_map_a_robot_is_lost_and_stays_lost() {
    let drive = simulated(3, 6, 50);
    let grid = drawn(&drive.world, 0.05, ALONG_AXES, drive.scans[0].1);
    // The next warehouse but one: everything is where nothing is known of it.
    let start = Pose2::new(300.0, 0.0, 0.0);
    let driven = driven(&mut LidarOdometry::with_map(&grid, start).unwrap(), &drive);
    assert!(
        driven
            .iter()
            .all(|(pose, _)| pose.tracking == Tracking::Lost && !pose.map_restarted)
    );
    // Another warehouse's map.
    let corner = Pose2::new(-35.5, -25.5, 0.0);
    let other = drawn(&World::empty_hall(), 0.2, corner, Pose2::IDENTITY);
    let mut odometry = LidarOdometry::with_map(&other, Pose2::IDENTITY).unwrap();
    for (scan, _) in &drive.scans {
        assert_eq!(odometry.process(scan).unwrap().tracking, Tracking::Lost);
    }
}

#[test]
fn a_kidnap_within_the_map_is_said_and_found() {
    let mut drive = simulated(10, 7, 200);
    drive.scans.drain(60..150);
    let start = drive.scans[0].1;
    let moved = drive.scans[59].1.between(&drive.scans[60].1);
    assert!(moved.translation().norm() > 3.0, "{moved:?}");
    // Nine seconds later by the world, a tenth of a second by the stamps.
    let jump_ns = drive.scans[60].0.stamp().0 - drive.scans[59].0.stamp().0 - 100_000_000;
    for (scan, _) in &mut drive.scans[60..] {
        let stamp = RobotTime(scan.stamp().0 - jump_ns);
        *scan = Scan::new(stamp, *scan.shape(), scan.ranges_m().into()).unwrap();
    }
    let grid = drawn(&drive.world, 0.05, ALONG_AXES, start);
    let driven = driven(&mut LidarOdometry::with_map(&grid, start).unwrap(), &drive);
    let after = &driven[60..];
    assert_eq!(after[0].0.tracking, Tracking::Lost);
    let found = after
        .iter()
        .position(|(pose, _)| pose.tracking == Tracking::Recovered)
        .unwrap();
    assert!(found <= 16, "{found}");
    let (_, largest_m, _) = errors(&after[found..]);
    assert!(largest_m < 0.02, "{largest_m}");
}

#[test]
fn after_the_clock_went_back_the_robot_is_looked_for_in_the_map_again() {
    let drive = simulated(10, 7, 60);
    let start = drive.scans[0].1;
    let grid = drawn(&drive.world, 0.05, ALONG_AXES, start);
    let mut odometry = LidarOdometry::with_map(&grid, start).unwrap();
    driven(&mut odometry, &drive);
    assert_eq!(odometry.process(&drive.scans[0].0), None);
    odometry.begin_anew();
    let again = driven(&mut odometry, &drive);
    let is_found = |(pose, _): &(OdometryPose, _)| pose.tracking != Tracking::Lost;
    let found = again.iter().position(is_found).unwrap();
    assert!(found <= 16, "{found}");
    let (_, largest_m, _) = errors(&again[found..]);
    assert!(largest_m < 0.02, "{largest_m}");
}

#[test]
fn what_the_map_lacks_is_learnt_beside_it() {
    let drive = simulated(3, 8, 400);
    let start = drive.scans[0].1;
    let whole = drawn(&drive.world, 0.05, ALONG_AXES, start);
    // Nobody has been right of x = -12 m.
    let cells = (0..whole.height() as i64)
        .flat_map(|row| (0..whole.width() as i64).map(move |column| (column, row)))
        .map(|(column, row)| {
            let is_known = whole.centre_m(column, row).x < -12.0;
            if is_known {
                whole.at(column, row)
            } else {
                Occupancy::Unknown
            }
        })
        .collect();
    let part = OccupancyGrid::new(0.05, ALONG_AXES, whole.width(), cells).unwrap();
    let mut odometry = LidarOdometry::with_map(&part, start).unwrap();
    let driven = driven(&mut odometry, &drive);
    assert_eq!(
        driven[0].0.tracking,
        Tracking::Degraded,
        "half of it is new"
    );
    let after = &driven[1..];
    assert!(
        after
            .iter()
            .all(|(pose, _)| pose.tracking == Tracking::Tracking)
    );
    let (_, largest_m, _) = errors(&driven);
    assert!(largest_m < 0.02, "{largest_m}");
    let fitness: f64 = driven[100..].iter().map(|(pose, _)| pose.fitness).sum();
    assert!(fitness / 300.0 > 0.8, "{}", fitness / 300.0);
    assert!(odometry.memory_bytes() < 4 << 20);
}
