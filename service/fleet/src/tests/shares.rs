//! A robot whose task has less CPU time than its scans need.

use fleetcal_model::{Parameter, ParameterStatus, WallTime};
use fleetcal_proto::estimate::ParameterDocument;
use fleetcal_robot::fleet::{drive_message, scan_message};
use fleetcal_robot::simulator::{SimulatedMessage, Simulation, SimulationConfig};

use super::*;
use crate::intake::Intake;
use crate::mailbox::{Item, Mailbox, Message, Outcome};
use crate::reading::ReadingSettings;

/// Duration for which the robot drives before CPU time is short, while it is, and after, s.
const BEFORE_S: f64 = 100.0;
const SHORT_S: f64 = 60.0;
const AFTER_S: f64 = 5.0;
/// Time between two turns of the task while CPU time is short, s.
const TURN_S: f64 = 2.0;
/// Parameters that are known before.
const KNOWN: [Parameter; 4] = [
    Parameter::SteeringOffset,
    Parameter::LidarX,
    Parameter::LidarY,
    Parameter::LidarYaw,
];

/// Robot whose task has its turn now and then.
struct Slow {
    mailbox: Mailbox,
    intake: Intake,
    calibrator: Calibrator,
    scans: usize,
}

impl Slow {
    fn new() -> Self {
        let config = vehicle();
        Self {
            mailbox: Mailbox::default(),
            intake: Intake::new(ReadingSettings::of(&config)),
            calibrator: Calibrator::new(config.basis(&EstimatorSettings::default()).calibrator),
            scans: 0,
        }
    }

    fn push(&self, message: SimulatedMessage) {
        let (stream, payload) = match message {
            SimulatedMessage::WheelOdometry(drive) => (
                Stream::WheelOdometry,
                drive_message(&drive).unwrap().to_cdr(),
            ),
            SimulatedMessage::Scan(scan) => (Stream::Scan, scan_message(scan).unwrap().to_cdr()),
            SimulatedMessage::LidarPose(_) | SimulatedMessage::CrossTrackError(_) => return,
        };
        self.mailbox.push(Message {
            stream,
            form: Encoding::Cdr.into(),
            origin: None,
            arrived_ns: WallTime(0),
            payload,
        });
    }

    /// Works off what waits, up to a number of scans.
    fn turn(&mut self, scans_max: usize) {
        let mut scans = 0;
        while scans < scans_max
            && let Some(Item::Message(message)) = self.mailbox.take()
        {
            scans += usize::from(message.stream == Stream::Scan);
            let taken = self
                .intake
                .take(message.stream, message.form, &message.payload);
            let taken = taken.unwrap();
            for decoded in taken.events {
                self.calibrator.step(decoded.event);
            }
            self.mailbox.finish(Outcome::Processed {
                stamp_ns: taken.stamp,
                drive_samples: 0,
            });
        }
        self.scans += scans;
    }

    fn parameter(&self, parameter: Parameter) -> ParameterDocument {
        let estimate = self.calibrator.estimate();
        let document = crate::document::estimate_document(&id("robot"), &estimate);
        document.parameters.get(parameter).clone()
    }

    fn assert_known(&self, truth: [f64; 4], when: &str) {
        for (parameter, truth) in KNOWN.into_iter().zip(truth) {
            let found = self.parameter(parameter);
            let is_known = found.status == ParameterStatus::Converged;
            assert!(is_known, "{when}: {parameter:?} {found:?}");
            let off = (found.value - truth).abs() / found.sigma;
            assert!(off < 4.0, "{when}: {parameter:?} {found:?}, true {truth}");
        }
    }
}

/// Drives with all of the CPU time, then with turns of so many scans, then with all again.
fn drive_with(scans_a_turn: usize) {
    let config = SimulationConfig::figure_eight(5);
    let mount = config.vehicle.lidar_in_base;
    let truth = [
        config.vehicle.steering_offset_rad,
        mount.x_m,
        mount.y_m,
        mount.yaw_rad,
    ];
    let mut simulation = Simulation::new(config).unwrap();
    let mut robot = Slow::new();
    for emitted in simulation.run(BEFORE_S) {
        robot.push(emitted.message);
        robot.turn(usize::MAX);
    }
    robot.assert_known(truth, "before");
    let (before, mut turns) = (robot.scans, 0.0);
    for emitted in simulation.run(SHORT_S) {
        robot.push(emitted.message);
        turns += 1.0 / (110.0 * TURN_S);
        if turns >= 1.0 {
            turns = 0.0;
            robot.turn(scans_a_turn);
        }
    }
    let used = robot.scans - before;
    robot.assert_known(truth, "while CPU time is short");
    assert!(robot.mailbox.is_thinning());
    for emitted in simulation.run(AFTER_S) {
        robot.push(emitted.message);
        robot.turn(usize::MAX);
    }
    robot.assert_known(truth, "after");
    assert!(!robot.mailbox.is_thinning());
    let counters = robot.mailbox.counters();
    let lost = (counters.dropped_wheel_odometry, counters.waiting);
    assert_eq!(lost, (0, 0), "{counters:?}");
    let share = used as f64 / (10.0 * SHORT_S);
    assert!(share > 0.08 && share < 0.5, "{share:.2} of the scans used");
}

#[test]
fn a_quarter_of_the_time_keeps_the_calibration() {
    drive_with(5);
}

#[test]
fn an_eighth_of_the_time_keeps_the_calibration() {
    drive_with(3);
}
