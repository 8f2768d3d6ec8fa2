//! Lost LiDAR odometry is named: the vehicle is not blamed, and no impossible value is published. A
//! robot that was lifted away or towed is reported.

use std::sync::Arc;

use fleetcal_estimator::Status;
use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::estimate::{Cause, ChangeKind};
use fleetcal_robot::simulator::{
    DriveSample, LidarOutput, LidarPose, LidarSettings, Point, Pose2, Route, SimulatedMessage,
    SimulationConfig, World,
};

use crate::drive::{Driven, FOUR, drive, drive_disturbed, error_of, poses, vehicle_of};

/// A robot in an empty place that sees so far, m.
fn featureless(seed: u64, world: World, route: Route, range_max_m: f64) -> Driven {
    let mut config = SimulationConfig::figure_eight(seed);
    config.world = Arc::new(world);
    config.people.count = 0;
    config.route = route;
    config.lidar = LidarOutput::Scans(LidarSettings {
        beams: 720,
        range_max_m,
        ..LidarSettings::default()
    });
    config.vehicle.steering_offset_rad = 0.03;
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, config.vehicle.wheelbase_m));
    drive(config, calibrator, 60.0)
}

/// Asserts that the lost odometry is the only report, and that no value is called known or is
/// impossible.
fn assert_lost(run: &Driven, name: &str) {
    assert!(!run.changes.is_empty(), "{name}: not reported");
    for change in &run.changes {
        let told = (change.kind, change.cause);
        assert_eq!(told, (ChangeKind::Fault, Cause::Odometry), "{name}");
    }
    for (estimate, truth) in &run.estimates {
        for parameter in FOUR {
            let found = estimate.parameter(parameter);
            let error = error_of(parameter, estimate, truth).abs();
            let at_s = estimate.time_s;
            assert_ne!(found.status, Status::Converged, "{name} at {at_s} s");
            assert!(error < 5.0, "{name} at {at_s} s: {found:?}");
        }
    }
}

#[test]
fn a_featureless_place_is_reported_as_lost_odometry_and_nothing_is_claimed() {
    let around = |x_m, y_m| Route::figure_eight(Point::new(x_m, y_m), 9.0, 4.0);
    for seed in 1..=3 {
        let middle = featureless(seed, World::empty_hall(), around(0.0, 0.0), 15.0);
        assert_lost(&middle, &format!("middle of a hall, seed {seed}"));
        for range_max_m in [10.0, 20.0] {
            // One wall is seen, and nothing along it.
            let wall = featureless(seed, World::empty_hall(), around(0.0, 18.0), range_max_m);
            assert_lost(&wall, &format!("one wall, {range_max_m} m, seed {seed}"));
        }
        let slalom = Route::slalom(Point::new(-60.0, 0.0), 120.0, 0.4, 8.0);
        let corridor = featureless(seed, World::corridor(), slalom, 15.0);
        assert_lost(&corridor, &format!("corridor, seed {seed}"));
    }
}

/// Time at which somebody takes hold of the robot, s.
const TAKEN_S: f64 = 60.0;

/// Robot that somebody holds for a while, in which it is moved with its wheels still. Its own
/// motion continues later, from its new place.
struct Taken {
    held_s: f64,
    moved: Pose2,
    last: Option<LidarPose>,
    put_from_left: Option<Pose2>,
}

impl Taken {
    fn disturb(&mut self, time_s: f64, message: &SimulatedMessage) -> Vec<SimulatedMessage> {
        let mut messages = Vec::new();
        if time_s >= TAKEN_S
            && self.put_from_left.is_none()
            && let (SimulatedMessage::WheelOdometry(drive), Some(before)) = (message, self.last)
        {
            messages = self.held(*drive, before);
            let put = before.pose.compose(&self.moved);
            self.put_from_left = Some(put.compose(&before.pose.inverse()));
        }
        let later_ns = (self.held_s * 1e9) as i64;
        let mut message = message.clone();
        match (&mut message, &self.put_from_left) {
            (SimulatedMessage::WheelOdometry(drive), Some(_)) => drive.stamp_ns += later_ns,
            (SimulatedMessage::LidarPose(pose), Some(put_from_left)) => {
                pose.stamp_ns += later_ns;
                pose.pose = put_from_left.compose(&pose.pose);
            }
            (SimulatedMessage::LidarPose(pose), None) => self.last = Some(*pose),
            _ => {}
        }
        messages.push(message);
        messages
    }

    /// Standing wheels at 100 Hz, poses on the way at 10 Hz.
    fn held(&self, mut drive: DriveSample, before: LidarPose) -> Vec<SimulatedMessage> {
        drive.speed_mps = 0.0;
        let steps = (self.held_s * 100.0) as i64;
        let mut messages = Vec::new();
        for step in 1..=steps {
            drive.stamp_ns += 10_000_000;
            messages.push(SimulatedMessage::WheelOdometry(drive));
            if step % 10 == 0 {
                let part = step as f64 / steps as f64;
                let moved = Pose2::new(part * self.moved.x_m, part * self.moved.y_m, 0.0);
                let mut pose = before;
                pose.stamp_ns += step * 10_000_000;
                pose.pose = before.pose.compose(&moved);
                messages.push(SimulatedMessage::LidarPose(pose));
            }
        }
        messages
    }
}

/// Asserts that it is reported once, as something that was done to the vehicle; the calibration
/// stays.
fn assert_taken(seed: u64, held_s: f64, moved: Pose2) {
    let mut config = SimulationConfig::figure_eight(seed);
    config.lidar = poses();
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, config.vehicle.wheelbase_m));
    let mut taken = Taken {
        held_s,
        moved,
        last: None,
        put_from_left: None,
    };
    let run = drive_disturbed(config, calibrator, 100.0, |time_s, message| {
        taken.disturb(time_s, &message)
    });
    let name = format!("moved by {moved:?} in {held_s} s, seed {seed}");
    let told: Vec<_> = run.changes.iter().map(|c| (c.kind, c.cause)).collect();
    assert_eq!(told, [(ChangeKind::Fault, Cause::Vehicle)], "{name}");
    let delay_s = run.changes[0].time_s - TAKEN_S - held_s;
    assert!(delay_s < 5.0, "{name}: {delay_s} s");
    let (estimate, truth) = run.last();
    for parameter in FOUR {
        let found = estimate.parameter(parameter);
        let error = error_of(parameter, estimate, truth).abs();
        assert_eq!(found.status, Status::Converged, "{name}");
        assert!(error < 4.0 * found.sigma, "{name}: {found:?}");
    }
}

#[test]
fn a_robot_that_was_lifted_away_is_reported_and_keeps_its_calibration() {
    for seed in 1..=8 {
        // Half a metre, in eight directions, at once.
        let (sin, cos) = (std::f64::consts::FRAC_PI_4 * seed as f64).sin_cos();
        assert_taken(seed, 0.1, Pose2::new(0.5 * cos, 0.5 * sin, 0.0));
    }
}

#[test]
fn a_robot_that_was_towed_is_reported_and_keeps_its_calibration() {
    for seed in 1..=8 {
        // 0.3 m at 3 cm/s.
        assert_taken(seed, 10.0, Pose2::new(0.3, 0.0, 0.0));
    }
}
