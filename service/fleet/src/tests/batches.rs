//! Drive samples that come several in one message.

use fleetcal_proto::message_type::{Form, MessageType};
use fleetcal_proto::ros::{DriveSamples, MeasuredDrive};
use fleetcal_robot::fleet::{DriveBatch, drive_message, lidar_pose_message};
use fleetcal_robot::simulator::{
    LidarOutput, PoseSettings, SimulatedMessage, Simulation, SimulationConfig,
};

use super::*;
use crate::intake::Intake;
use crate::joining::JoiningChecks;
use crate::reading::{self, ReadingSettings};

/// Duration of the drive, s.
const DRIVE_S: f64 = 90.0;

/// Message as it is sent.
struct Sent {
    stream: Stream,
    form: Form,
    arrival_ns: i64,
    payload: Vec<u8>,
}

fn form(message_type: MessageType) -> Form {
    Form {
        encoding: Encoding::Cdr,
        message_type: Some(message_type),
    }
}

fn samples_of(payload: &DriveSamples, arrival_ns: i64) -> Sent {
    Sent {
        stream: Stream::WheelOdometry,
        form: form(MessageType::DriveSamples),
        arrival_ns,
        payload: payload.to_cdr(),
    }
}

/// Course by which a robot sends its drive samples.
#[derive(Clone, Copy, PartialEq)]
enum Sending {
    /// One by one.
    Single,
    /// Up to 100 ms of them, at the latest before a pose.
    BeforePoses,
    /// When 100 ms of them are complete, whatever was sent meanwhile.
    WhenFull,
}

/// Messages of one drive.
fn sent(sending: Sending) -> Vec<Sent> {
    let mut config = SimulationConfig::figure_eight(11);
    config.lidar = LidarOutput::Poses(PoseSettings::default());
    config.people.count = 0;
    let first_pose_ns = config.start_stamp_ns + 200_000_000;
    let mut batch = DriveBatch::default();
    let mut all = Vec::new();
    for emitted in Simulation::new(config).unwrap().run(DRIVE_S) {
        let arrival_ns = emitted.sent_ns;
        match emitted.message {
            SimulatedMessage::WheelOdometry(drive) if sending == Sending::Single => {
                all.push(Sent {
                    stream: Stream::WheelOdometry,
                    form: Encoding::Cdr.into(),
                    arrival_ns,
                    payload: drive_message(&drive).unwrap().to_cdr(),
                });
            }
            SimulatedMessage::WheelOdometry(drive) => {
                let full = batch.add(&drive).unwrap();
                all.extend(full.map(|full| samples_of(&full, arrival_ns)));
            }
            // A session starts with the message that comes first: a drive sample.
            SimulatedMessage::LidarPose(pose) if pose.stamp_ns < first_pose_ns => {}
            SimulatedMessage::LidarPose(pose) => {
                if sending == Sending::BeforePoses {
                    let waiting = batch.take().unwrap();
                    all.extend(waiting.map(|waiting| samples_of(&waiting, arrival_ns)));
                }
                all.push(Sent {
                    stream: Stream::LidarOdometry,
                    form: Encoding::Cdr.into(),
                    arrival_ns,
                    payload: lidar_pose_message(&pose).unwrap().to_cdr(),
                });
            }
            SimulatedMessage::Scan(_) | SimulatedMessage::CrossTrackError(_) => {}
        }
    }
    let waiting = batch.take().unwrap();
    all.extend(waiting.map(|waiting| samples_of(&waiting, 0)));
    all
}

/// Effects of the estimator, to the last digit, and the number of messages of wheel odometry.
fn effects(sending: Sending) -> (Vec<String>, usize) {
    let config = vehicle();
    let mut intake = Intake::new(ReadingSettings::of(&config));
    let mut checks = JoiningChecks::of_robot(&config, &[]);
    let basis = config.basis(&EstimatorSettings::default());
    let mut calibrator = Calibrator::new(basis.calibrator);
    let (mut effects, mut messages) = (Vec::new(), 0);
    let mut step = |event| {
        for effect in calibrator.step(event) {
            effects.push(format!("{effect:?}"));
        }
    };
    for message in sent(sending) {
        messages += usize::from(message.stream == Stream::WheelOdometry);
        let read = reading::Message {
            stream: message.stream,
            form: message.form,
            payload: &message.payload,
            arrived: RobotTime(message.arrival_ns),
        };
        let sighting = intake.sight(&read);
        let taken = intake.take(&read);
        checks.take(
            message.stream,
            message.arrival_ns,
            sighting.as_ref(),
            &taken,
        );
        for decoded in taken.unwrap().events {
            step(decoded.event);
        }
    }
    step(Event::EndOfSession);
    let report = checks.report(|stream| stream.name().to_owned());
    if sending != Sending::WhenFull {
        effects.push(format!("{:?}", report.findings));
    }
    (effects, messages)
}

#[test]
fn the_same_samples_in_one_message_or_singly_give_the_same_bits() {
    let (singly, messages) = effects(Sending::Single);
    let estimates = singly.iter().filter(|one| one.starts_with("Estimate"));
    assert!(estimates.count() > 80, "{}", singly.len());
    assert_eq!(messages, 9_000);
    for sending in [Sending::BeforePoses, Sending::WhenFull] {
        let (together, messages) = effects(sending);
        assert!(messages < 1_000, "{messages}");
        let findings = usize::from(sending == Sending::WhenFull);
        let singly = &singly[..singly.len() - findings];
        for (one, other) in singly.iter().zip(&together) {
            assert_eq!(one, other);
        }
        assert_eq!(singly.len(), together.len());
    }
}

/// Message of ten drive samples, the first at `number` hundredths of a second.
fn ten(number: i64) -> DriveSamples {
    let sample = |place| MeasuredDrive {
        stamp: Time::from_ns(BEGIN_NS + (number + place) * 10_000_000).unwrap(),
        steering_angle: 0.1,
        speed: 1.0,
    };
    DriveSamples::new((0..10).map(sample).collect()).unwrap()
}

impl Bench {
    fn send_several(&self, encoding: Encoding, payload: &[u8]) {
        let form = Form {
            encoding,
            message_type: Some(MessageType::DriveSamples),
        };
        let bytes = || payload.to_vec();
        let stream = Stream::WheelOdometry;
        self.fleet
            .receive(&id("robot"), stream, form, payload.len(), bytes);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn messages_and_their_samples_are_counted() {
    let bench = bench(&["robot"]);
    for number in 0..20 {
        let message = ten(10 * number);
        if number % 2 == 0 {
            bench.send_several(Encoding::Cdr, &message.to_cdr());
        } else {
            bench.send_several(Encoding::Json, &message.to_json().unwrap());
        }
    }
    bench.send("robot", Stream::WheelOdometry, &drive(200));
    bench.worked_off("robot").await;
    bench.check_accounts("robot");
    let counters = bench.view("robot").counters;
    let counted = (
        counters.received,
        counters.processed,
        counters.drive_samples,
    );
    assert_eq!(counted, (21, 21, 201), "{counters:?}");
    let progress = bench.fleet.progress(&id("robot")).unwrap();
    assert_eq!(progress.drive_samples, 21);
    assert_eq!(progress.stamp_ns, RobotTime(BEGIN_NS + 200 * 10_000_000));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_message_with_one_impossible_sample_is_refused_whole() {
    let bench = bench(&["robot"]);
    let mut samples = ten(0).samples().to_vec();
    samples[7].speed = 51.0;
    let too_fast = DriveSamples::new(samples).unwrap();
    bench.send_several(Encoding::Cdr, &too_fast.to_cdr());
    // The stamp of the second sample is that of the first.
    let mut repeated = ten(0).to_cdr();
    let (first, second) = repeated[8..].split_at_mut(16);
    second[..8].copy_from_slice(&first[..8]);
    bench.send_several(Encoding::Cdr, &repeated);
    bench.worked_off("robot").await;
    bench.check_accounts("robot");
    let counters = bench.view("robot").counters;
    let counted = (counters.processed, counters.refused, counters.drive_samples);
    assert_eq!(counted, (0, 2, 0));
    let reason = counters.last_refusal.unwrap();
    assert!(reason.contains("samples[1].stamp: got "), "{reason}");
    let message = reading::Message {
        stream: Stream::WheelOdometry,
        form: form(MessageType::DriveSamples),
        payload: &too_fast.to_cdr(),
        arrived: RobotTime(BEGIN_NS),
    };
    let refused = message.read(&ReadingSettings::default());
    let reason = refused.unwrap_err().to_string();
    assert!(
        reason.starts_with("wheel_odometry: samples[7]: drive.speed: got 51"),
        "{reason}"
    );
}
