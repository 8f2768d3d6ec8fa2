//! Content and size of a simulated robot's checkpoint.

use fleetcal_domain::robot::Basis;
use fleetcal_estimator::stream::ScanShape;
use fleetcal_estimator::{Checkpoint, DriveSample, LidarPose, Note, NoteKind, Pose2, Scan};
use fleetcal_robot::simulator::{
    self, LidarOutput, PoseSettings, ScheduledChange, SimulatedMessage, Simulation,
    SimulationConfig,
};
use nalgebra::Matrix3;

use super::*;
use crate::candidate::Candidate;
use crate::packed;
use crate::robot::Robot;
use crate::stored::{self, Restored, Stored, StoredConfig};
use crate::verification_run::VerificationRun;

/// Largest size of a checkpoint, bytes.
const BYTES_MAX: usize = 10_000;
/// Largest size of a checkpoint during verification, bytes.
const VERIFYING_BYTES_MAX: usize = 20_000;

/// A simulated robot, its estimator, and during verification a second one.
struct Drive {
    simulation: Simulation,
    robot: Robot,
    basis: Basis,
    restored: Restored,
}

impl Drive {
    fn new(simulation: SimulationConfig) -> Self {
        let basis = vehicle().basis(&EstimatorSettings::default());
        Self {
            simulation: Simulation::new(simulation).unwrap(),
            robot: Robot::new(id("robot"), Some(vehicle())),
            restored: Restored::nothing(&basis.calibrator),
            basis,
        }
    }

    /// Puts values in verification.
    fn verify(&mut self) {
        let in_verification = Some((Generation(1), RobotTime(7)));
        self.robot.set_used(&[], in_verification);
        self.robot.values_heard(RobotTime(0));
        let calibrator = &self.restored.calibrator;
        let scanner = || Some(calibrator.learnt_scanner());
        self.restored.verification_run =
            VerificationRun::follow(None, &self.robot, &self.basis.calibrator, scanner);
    }

    /// Notes that the robot was switched on: the known values wait for a comparison with new ones.
    fn power_on(&mut self) {
        let stamp = RobotTime(self.simulation.stamp_ns());
        let kind = NoteKind::PowerOn;
        self.feed(&[Event::Note(Note { stamp, kind })]);
    }

    fn events(&mut self, duration_s: f64) -> Vec<Event> {
        let emitted = self.simulation.run(duration_s).into_iter();
        emitted.filter_map(|one| event_of(one.message)).collect()
    }

    /// Feeds both estimators and returns the effects of the robot's own one.
    fn feed(&mut self, events: &[Event]) -> Vec<Effect> {
        let mut effects = Vec::new();
        for event in events {
            let run = self.restored.verification_run.take();
            self.restored.verification_run = run.and_then(|run| run.take(&self.robot, event));
            effects.extend(self.restored.calibrator.step(event.clone()));
        }
        effects
    }

    fn drive(&mut self, duration_s: f64) {
        let events = self.events(duration_s);
        self.feed(&events);
    }

    fn stored(&self) -> Stored {
        let run = self.restored.verification_run.as_ref();
        Stored {
            config: StoredConfig::of(&self.basis).unwrap(),
            calibrator: self.restored.calibrator.checkpoint(),
            changed: self.restored.changed,
            candidate: self.restored.candidate.clone(),
            verification_run: run.map(VerificationRun::to_stored),
            notes: None,
            findings: Vec::new(),
        }
    }

    fn bytes(&self) -> Vec<u8> {
        self.stored().to_bytes().unwrap()
    }

    /// Returns the size of the largest checkpoint of a drive, with one every five seconds, bytes.
    fn largest(&mut self, duration_s: f64) -> usize {
        let steps = (duration_s / 5.0) as usize;
        let sizes = (0..steps).map(|_| {
            self.drive(5.0);
            self.bytes().len()
        });
        sizes.max().unwrap()
    }
}

fn event_of(message: SimulatedMessage) -> Option<Event> {
    match message {
        SimulatedMessage::WheelOdometry(one) => {
            let stamp = RobotTime(one.stamp_ns);
            let sample = DriveSample::new(stamp, one.speed_mps, one.steering_rad);
            Some(Event::WheelOdometry(sample.unwrap()))
        }
        SimulatedMessage::Scan(one) => {
            let shape = ScanShape {
                angle_min_rad: one.angle_min_rad,
                angle_increment_rad: one.angle_increment_rad,
                time_increment_s: one.time_increment_s,
                range_min_m: one.range_min_m,
                range_max_m: one.range_max_m,
            };
            let scan = Scan::new(RobotTime(one.stamp_ns), shape, one.ranges_m.into());
            Some(Event::Scan(scan.unwrap()))
        }
        SimulatedMessage::LidarPose(one) => {
            let covariance = one.covariance.map(|c| Matrix3::from_fn(|i, j| c[i][j]));
            let pose = Pose2::new(one.pose.x_m, one.pose.y_m, one.pose.yaw_rad);
            let pose = LidarPose::new(RobotTime(one.stamp_ns), pose, covariance);
            Some(Event::LidarPose(pose.unwrap()))
        }
        SimulatedMessage::CrossTrackError(_) => None,
    }
}

/// Configures a robot on the figure-eight whose own odometry sends poses.
fn poses() -> SimulationConfig {
    let mut config = SimulationConfig::figure_eight(5);
    config.vehicle.steering_offset_rad = 0.05;
    config.lidar = LidarOutput::Poses(PoseSettings::default());
    config
}

#[test]
fn a_checkpoint_has_10_kb_and_20_kb_in_verification() {
    let mut scans = SimulationConfig::figure_eight(4);
    scans.vehicle.steering_offset_rad = 0.05;
    let mut knocked = poses();
    let knocks = [60.0, 90.0].map(|at_s| ScheduledChange {
        at_s,
        change: simulator::Change::Mount(simulator::Pose2::new(0.1, 0.1, 0.1)),
    });
    knocked.changes = knocks.to_vec();
    let mut loose = poses();
    let mounts = (0..20).map(|knock: u8| ScheduledChange {
        at_s: 60.0 + 25.0 * f64::from(knock),
        change: simulator::Change::Mount(match knock % 2 {
            0 => simulator::Pose2::new(0.1, 0.1, 0.1),
            _ => simulator::Pose2::new(0.0, 0.0, 0.0),
        }),
    });
    loose.changes = mounts.collect();
    for (name, config, alone_s, changes) in [
        ("poses", poses(), 150.0, 0),
        ("scans", scans, 150.0, 0),
        ("knocked", knocked, 150.0, 2),
        ("loose", loose, 600.0, 10),
    ] {
        let mut drive = Drive::new(config);
        let alone = drive.largest(alone_s);
        let seen = drive.restored.calibrator.changes().len();
        assert!(seen >= changes, "{name}: {seen} changes seen");
        drive.power_on();
        let again = drive.largest(30.0);
        drive.verify();
        let verifying = drive.largest(90.0);
        println!("{name}: {alone} bytes, {again} after power on, {verifying} in verification");
        let alone = alone.max(again);
        assert!(alone <= BYTES_MAX, "{name}: {alone} bytes");
        assert!(
            verifying <= VERIFYING_BYTES_MAX,
            "{name}: {verifying} bytes in verification"
        );
    }
}

#[test]
fn a_restored_task_has_every_bit_of_the_one_that_was_stored() {
    let mut drive = Drive::new(poses());
    drive.drive(40.0);
    drive.verify();
    drive.drive(30.0);
    drive.restored.changed = true;
    let (bytes, before) = (drive.bytes(), drive.stored());
    let restored = stored::restore(&id("robot"), &drive.basis, &bytes).unwrap();
    assert!(restored.changed);
    // Goes on from the state itself, which was no bytes in between.
    let mut kept = Restored::nothing(&drive.basis.calibrator);
    kept.calibrator =
        Calibrator::restore(drive.basis.calibrator.clone(), &before.calibrator).unwrap();
    let run = before.verification_run.unwrap();
    kept.verification_run = Some(VerificationRun::restore(&drive.basis.calibrator, &run).unwrap());
    kept.changed = true;

    drive.restored = restored;
    assert_eq!(drive.bytes(), bytes, "what is stored again is the same");
    let events = drive.events(20.0);
    let from_bytes = (drive.feed(&events), drive.bytes());
    drive.restored = kept;
    let from_state = (drive.feed(&events), drive.bytes());
    assert_eq!(from_bytes.0, from_state.0, "every effect");
    assert_eq!(from_bytes.1, from_state.1, "every bit of both estimators");
}

#[test]
fn text_of_a_former_version_is_gone_on_from() {
    let mut drive = Drive::new(poses());
    drive.drive(40.0);
    let stored = drive.stored();
    let former = serde_json::json!({"config": stored.config, "calibrator": stored.calibrator});
    let restored = stored::restore(
        &id("robot"),
        &drive.basis,
        &serde_json::to_vec(&former).unwrap(),
    );
    let restored = restored.unwrap();
    let is_same = restored.calibrator.checkpoint() == stored.calibrator;
    assert!(is_same, "the estimator is another one");
    assert_eq!(restored.candidate, Candidate::default());
    assert!(!restored.changed && restored.verification_run.is_none());
}

#[test]
fn another_format_or_configuration_begins_from_nothing() {
    let mut drive = Drive::new(poses());
    drive.drive(10.0);
    let bytes = drive.bytes();
    let restore = |config: &Basis, bytes: &[u8]| {
        let restored = stored::restore(&id("robot"), config, bytes);
        restored.is_some_and(|restored| restored.calibrator.filter().is_some())
    };
    assert_eq!(bytes.first(), Some(&packed::FORMAT));
    assert!(restore(&drive.basis, &bytes));
    let mut later = bytes.clone();
    later[0] += 1;
    assert!(!restore(&drive.basis, &later));
    assert!(!restore(&drive.basis, b"nonsense"));
    let longer = RobotConfig {
        wheelbase_m: Wheelbase::try_from(1.3).unwrap(),
        ..vehicle()
    };
    let longer = longer.basis(&EstimatorSettings::default());
    assert!(!restore(&longer, &bytes));
    let compensated = RobotConfig {
        wheel_odometry: WheelOdometrySignal::Compensated,
        ..vehicle()
    };
    let compensated = compensated.basis(&EstimatorSettings::default());
    assert!(
        !restore(&compensated, &bytes),
        "its angles meant something else"
    );
    let mut unsure = drive.basis.clone();
    unsure.calibrator.settings.false_alarm_hours *= 2.0;
    assert!(!restore(&unsure, &bytes));
}

/// While a cluster is upgraded, a robot moves between versions of which one knows a setting that the other does
/// not.
#[test]
fn a_setting_that_one_version_alone_knows_loses_no_state() {
    let mut drive = Drive::new(poses());
    drive.drive(10.0);
    let mut content = serde_json::to_value(drive.stored()).unwrap();
    let settings = content["config"]["settings"].as_object_mut().unwrap();
    assert!(settings.remove("false_alarm_hours").is_some());
    settings.insert("of_the_next_version".to_owned(), 0.5.into());
    for noise in ["/config/settings/motion_noise", "/calibrator/filter/noise"] {
        let noise = content.pointer_mut(noise).unwrap();
        noise["of_the_next_version"] = 0.5.into();
    }
    let bytes = packed::pack(&content).unwrap();
    let restored = stored::restore(&id("robot"), &drive.basis, &bytes).unwrap();
    assert!(restored.calibrator.filter().is_some());
}

/// Checks that a new layout has a new format: an instance claims a robot by the format of its
/// state, and must not claim one with a layout that it cannot read.
#[test]
fn a_new_layout_of_the_estimators_state_is_a_new_format() {
    assert_eq!((Checkpoint::VERSION, packed::FORMAT), (9, 4));
}
