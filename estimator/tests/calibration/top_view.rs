//! Top view of a robot, as people see it.

use fleetcal_estimator::Calibrator;
use fleetcal_estimator::calibrator::{CalibratorConfig, TopViewLimits};
use fleetcal_robot::simulator::SimulationConfig;

use crate::drive::{drive, poses, vehicle_of};

const LIMITS: TopViewLimits = TopViewLimits {
    reach_m: 15.0,
    surfaces_max: 1500,
    trajectory_m: 15.0,
    trajectory_points_max: 50,
};

#[test]
fn corrected_steering_follows_the_lidar_and_raw_steering_does_not() {
    let mut config = SimulationConfig::figure_eight(21);
    config.vehicle.steering_offset_rad = 0.04;
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, 1.2));
    let run = drive(config, calibrator.clone(), 40.0);
    let view = run.calibrator.top_view(&LIMITS).unwrap();

    // 1. The trajectories: 15 m at a wrong curvature of tan(0.04)/1.2 1/m.
    let (first, last) = (&view.trajectory[0], view.trajectory.last().unwrap());
    assert!(
        (15.0..16.0).contains(&view.distance_m),
        "{}",
        view.distance_m
    );
    assert!((25..=50).contains(&view.trajectory.len()));
    assert_eq!(first.by_lidar, first.by_raw_steering);
    assert_eq!(first.by_lidar, first.by_corrected_steering);
    let off = |pose: fleetcal_estimator::Pose2| {
        let off = pose.translation() - last.by_lidar.translation();
        off.norm()
    };
    let (raw_m, corrected_m) = (off(last.by_raw_steering), off(last.by_corrected_steering));
    println!(
        "after {:.1} m: raw {raw_m:.3} m, corrected {corrected_m:.3} m",
        view.distance_m
    );
    assert!(raw_m > 0.5 && corrected_m < 0.1 && corrected_m < 0.1 * raw_m);
    let times = view
        .trajectory
        .windows(2)
        .map(|pair| pair[1].stamp.seconds_since(pair[0].stamp));
    assert!(times.into_iter().all(|dt| dt > 0.0));

    // 2. The scan lies on the map, and both are within their bounds.
    let seen = view.surroundings.unwrap();
    assert_eq!(
        (seen.stamp, seen.lidar_in_odom),
        (view.stamp, view.lidar_in_odom)
    );
    assert!(!seen.is_lost && seen.returns_m.len() > 300);
    assert!(seen.surfaces_m.len() > 200 && seen.surfaces_m.len() <= LIMITS.surfaces_max);
    let far = |[x, y]: [f64; 2]| (x - view.lidar_in_odom.x_m).hypot(y - view.lidar_in_odom.y_m);
    assert!(
        seen.surfaces_m
            .iter()
            .all(|&point| far(point) <= LIMITS.reach_m)
    );
    let near = |a: [f64; 2], b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]) < 0.15;
    let within: Vec<_> = seen
        .returns_m
        .iter()
        .filter(|&&p| far(p) < LIMITS.reach_m)
        .collect();
    let on_map = within
        .iter()
        .filter(|&&&p| seen.surfaces_m.iter().any(|s| near(p, s)))
        .count();
    println!(
        "{on_map} of {} returns lie on {} surfaces",
        within.len(),
        seen.surfaces_m.len()
    );
    assert!(on_map * 10 > within.len() * 8);

    // 3. Fewer are the nearest.
    let few = TopViewLimits {
        surfaces_max: 20,
        ..LIMITS
    };
    let nearest = run
        .calibrator
        .top_view(&few)
        .unwrap()
        .surroundings
        .unwrap()
        .surfaces_m;
    assert_eq!(nearest, seen.surfaces_m[..20]);
}

#[test]
fn a_robot_that_sends_poses_has_trajectories_but_no_map() {
    let mut config = SimulationConfig::figure_eight(22);
    config.lidar = poses();
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, 1.2));
    assert_eq!(Calibrator::new(calibrator.clone()).top_view(&LIMITS), None);
    let soon = drive(config.clone(), calibrator.clone(), 1.0).calibrator;
    let view = soon.top_view(&LIMITS).unwrap();
    assert!(view.trajectory.is_empty() && view.lidar_in_base.is_none());
    let later = drive(config, calibrator, 40.0).calibrator;
    let view = later.top_view(&LIMITS).unwrap();
    assert!(view.surroundings.is_none() && view.lidar_in_base.is_some());
    assert!(view.trajectory.len() > 25);
}
