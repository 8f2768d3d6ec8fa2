//! Expected gain beside what simulated robots report before and after a calibration is applied.

use fleetcal_domain::approval::{
    Evidence, ExpectedGain, Origin, Policy, Revision, expected_gain, nominal_values,
};
use fleetcal_model::{RevisionId, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_robot::simulator::{
    Applied, LidarOutput, Pose2, PoseSettings, Route, SimulatedMessage, Simulation,
    SimulationConfig,
};

use super::*;

/// Duration for which each robot drives with its drawing, and then with its true calibration, s.
const BEFORE_S: f64 = 90.0;
const AFTER_S: f64 = 150.0;
/// Factor within which the forecast has to hold.
const FACTOR: f64 = 1.5;

/// Errors of a robot's drawing: steering, degrees, and LiDAR, mm and degrees.
type Off = (f64, (f64, f64, f64));

/// Offsets of either sign, large and small, alone and in combinations that add up or cancel.
const OFF: [Off; 12] = [
    (2.92, (0.0, 0.0, 0.0)),
    (-1.25, (0.0, 0.0, 0.0)),
    (0.4, (0.0, 0.0, 0.0)),
    (-0.25, (5.0, 5.0, 0.1)),
    (0.0, (35.0, -20.0, 0.0)),
    (0.0, (-30.0, 10.0, 0.0)),
    (0.0, (0.0, 0.0, 1.5)),
    (2.5, (20.0, 20.0, 1.2)),
    (2.5, (-20.0, 20.0, -1.2)),
    (-1.2, (25.0, -15.0, 0.55)),
    (-1.2, (-25.0, 15.0, -0.55)),
    (1.5, (40.0, 30.0, -0.7)),
];

fn robot(seed: u64, route: Route, (steering_deg, mount): Off) -> SimulationConfig {
    let mut config = SimulationConfig::figure_eight(seed);
    config.route = route;
    // Its path following needs no scans.
    config.people.count = 0;
    config.lidar = LidarOutput::Poses(PoseSettings::default());
    let drawn = config.applied.lidar_in_base;
    let (x_mm, y_mm, yaw_deg) = mount;
    config.vehicle.steering_offset_rad = steering_deg.to_radians();
    config.vehicle.lidar_in_base = Pose2::new(
        drawn.x_m + 1e-3 * x_mm,
        drawn.y_m + 1e-3 * y_mm,
        drawn.yaw_rad + yaw_deg.to_radians(),
    );
    config
}

/// Drives on and adds the errors that the robot reports.
fn drive(simulation: &mut Simulation, tracks: &mut CrossTracks, generation: u64, seconds: f64) {
    for emitted in simulation.run(seconds) {
        if let SimulatedMessage::CrossTrackError(error) = emitted.message {
            tracks.add(Generation(generation), error.stamp_ns, error.value_m);
        }
    }
}

/// Returns the gain promised to a robot, and the RMS that it reports afterwards, m.
fn promised_and_measured(config: SimulationConfig) -> (ExpectedGain, f64) {
    let truth = config.vehicle;
    let nominal = config.applied.lidar_in_base;
    let mut simulation = Simulation::new(config).unwrap();
    let mut tracks = CrossTracks::default();
    drive(&mut simulation, &mut tracks, 0, BEFORE_S);

    let values = |steering_offset_rad: f64, mount: Pose2| CalibrationValues {
        steering_offset_rad,
        ..nominal_values(&mount)
    };
    let sigmas = values(5e-4, Pose2::new(0.002, 0.002, 5e-4));
    let revision = Revision::new(
        RevisionId(1),
        RobotId::parse("tugger_01").unwrap(),
        Origin::Estimator,
        (
            values(truth.steering_offset_rad, truth.lidar_in_base),
            sigmas,
        ),
        Evidence::default(),
        None,
        WallTime(0),
    );
    let base = values(0.0, nominal);
    let tolerance = Policy::default().verify_within;
    let before = &tracks.all()[&Generation(0)];
    let promise = expected_gain(&base, &revision, before, &tolerance).unwrap();

    simulation.set_applied(Applied {
        steering_offset_rad: truth.steering_offset_rad,
        lidar_in_base: truth.lidar_in_base,
    });
    // Until it is back on its path.
    drive(&mut simulation, &mut CrossTracks::default(), 1, 10.0);
    drive(&mut simulation, &mut tracks, 1, AFTER_S);
    (promise, tracks.all()[&Generation(1)].rms_m())
}

/// Asserts that the forecast holds for a robot on a route, by `expected_rms_m` itself or by the
/// span above it; and that it is worth acting on where the error is a degree or more.
fn check(seed: u64, route: &Route, off: Off, is_near: fn(&ExpectedGain, f64) -> bool) {
    let (promise, after_m) = promised_and_measured(robot(seed, route.clone(), off));
    let mm = [
        promise.measured_rms_m,
        promise.expected_rms_m,
        promise.expected_rms_max_m,
        after_m,
    ];
    let mm = mm.map(|metres| (1e4 * metres).round() / 10.0);
    let said = format!("{off:?}: before, expected from, to, and found {mm:?} mm");
    println!("{said}");
    assert!(is_near(&promise, after_m), "{said}");
    let (steering_deg, (_, _, yaw_deg)) = off;
    let is_large = steering_deg.abs().max(yaw_deg.abs()) >= 1.0;
    let gains = promise.expected_rms_m < 0.7 * promise.measured_rms_m;
    assert!(gains || !is_large, "{said}");
}

#[test]
fn robots_get_what_was_expected() {
    let route = Route::staging_figure_eight();
    for (seed, off) in (1..).zip(OFF) {
        check(seed, &route, off, |promise, after_m| {
            let factor = promise.expected_rms_m / after_m;
            (1.0 / FACTOR..=FACTOR).contains(&factor)
        });
    }
}

#[test]
fn what_narrow_bends_leave_is_within_what_was_expected() {
    // Steering that lags leaves errors of its own in each of them.
    let route = Route::aisle_loop();
    for (seed, off) in (1..).zip(OFF) {
        check(seed, &route, off, |promise, after_m| {
            after_m > promise.expected_rms_m && after_m < promise.expected_rms_max_m
        });
    }
}
