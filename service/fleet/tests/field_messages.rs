//! Messages as robots in the field send them, their bytes laid here by their definitions.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use fleetcal_domain::robot::RobotConfig;
use fleetcal_estimator::{DriveSample, Event, RobotTime};
use fleetcal_fleet::{Intake, ReadMessage, ReadingSettings};
use fleetcal_model::Stream;
use fleetcal_proto::message_type::{Form, MessageType};

const SECOND: i32 = 1_700_000_000;
const ARRIVED: RobotTime = RobotTime(1_700_000_100_000_000_000);

/// CDR in little endian: each number aligned to its size, as counted behind the header.
#[derive(Default)]
struct Cdr(Vec<u8>);

impl Cdr {
    fn raw<const N: usize>(mut self, bytes: [u8; N]) -> Self {
        self.0.resize(self.0.len().next_multiple_of(N), 0);
        self.0.extend(bytes);
        self
    }

    fn u32(self, value: u32) -> Self {
        self.raw(value.to_le_bytes())
    }

    fn i32s(self, values: &[i32]) -> Self {
        values
            .iter()
            .fold(self, |to, value| to.raw(value.to_le_bytes()))
    }

    fn f32s(self, values: &[f32]) -> Self {
        values
            .iter()
            .fold(self, |to, value| to.raw(value.to_le_bytes()))
    }

    fn f64s(self, values: &[f64]) -> Self {
        values
            .iter()
            .fold(self, |to, value| to.raw(value.to_le_bytes()))
    }

    fn f64_sequence(self, values: &[f64]) -> Self {
        self.u32(values.len() as u32).f64s(values)
    }

    fn f32_sequence(self, values: &[f32]) -> Self {
        self.u32(values.len() as u32).f32s(values)
    }

    fn string(self, text: &str) -> Self {
        let mut to = self.u32(text.len() as u32 + 1);
        to.0.extend(text.bytes());
        to.0.push(0);
        to
    }

    fn strings(self, texts: &[&str]) -> Self {
        let to = self.u32(texts.len() as u32);
        texts.iter().fold(to, |to, text| to.string(text))
    }

    fn stamp(self, ms: u32) -> Self {
        self.i32s(&[SECOND]).u32(ms * 1_000_000)
    }

    fn header(self, ms: u32, frame: &str) -> Self {
        self.stamp(ms).string(frame)
    }

    fn payload(self) -> Vec<u8> {
        let mut payload = vec![0, 1, 0, 0];
        payload.extend(self.0);
        payload
    }
}

fn intake(streams: &str) -> Intake {
    let config = format!("model = 'bicycle'\nwheelbase_m = 1.2\n[streams]\n{streams}");
    let config: RobotConfig = toml::from_str(&config).unwrap();
    Intake::new(ReadingSettings::of(&config))
}

struct Sent {
    stream: Stream,
    of: MessageType,
    payload: Vec<u8>,
}

/// Drive samples that messages make, or the sentence of the first refusal.
fn samples(intake: &mut Intake, sent: &[Sent]) -> Result<Vec<DriveSample>, String> {
    let mut samples = Vec::new();
    for Sent {
        stream,
        of,
        payload,
    } in sent
    {
        let message = ReadMessage {
            stream: *stream,
            form: Form {
                message_type: Some(*of),
                ..Form::default()
            },
            payload,
            arrived: ARRIVED,
        };
        let taken = intake
            .take(&message)
            .map_err(|refused| refused.to_string())?;
        samples.extend(
            taken
                .events
                .into_iter()
                .filter_map(|decoded| match decoded.event {
                    Event::WheelOdometry(sample) => Some(sample),
                    _ => None,
                }),
        );
    }
    Ok(samples)
}

fn whole(of: MessageType, payload: Cdr) -> Sent {
    Sent {
        stream: Stream::WheelOdometry,
        of,
        payload: payload.payload(),
    }
}

fn steering(of: MessageType, payload: Cdr) -> Sent {
    Sent {
        stream: Stream::Steering,
        ..whole(of, payload)
    }
}

fn speed(of: MessageType, payload: Cdr) -> Sent {
    Sent {
        stream: Stream::Speed,
        ..whole(of, payload)
    }
}

/// Asserts the only sample: its speed, its angle and its stamp.
#[track_caller]
fn assert_sample(samples: Result<Vec<DriveSample>, String>, wanted: (f64, f64), stamp_ms: i64) {
    let samples = samples.unwrap();
    assert_eq!(samples.len(), 1, "{samples:?}");
    let sample = samples.first().unwrap();
    assert!((sample.speed_mps() - wanted.0).abs() < 1e-6, "{sample:?}");
    assert!(
        (sample.steering_rad() - wanted.1).abs() < 1e-6,
        "{sample:?}"
    );
    let ms = (sample.stamp().0 - i64::from(SECOND) * 1_000_000_000) / 1_000_000;
    assert_eq!(ms, stamp_ms);
}

fn odometry(ms: u32, speed_mps: f64, yaw_rate_radps: f64) -> Cdr {
    let to = Cdr::default().header(ms, "odom").string("base_link");
    let to = to
        .f64s(&[3.0, 4.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        .f64s(&[0.1; 36]);
    to.f64s(&[speed_mps, 0.0, 0.0, 0.0, 0.0, yaw_rate_radps])
        .f64s(&[0.1; 36])
}

#[test]
fn odometry_alone_tells_the_steering_by_the_yaw_rate() {
    let mut intake = intake("");
    let of = |ms, v, w| whole(MessageType::Odometry, odometry(ms, v, w));
    let angle = (1.2 * 0.2 / 0.8_f64).atan();
    assert_sample(samples(&mut intake, &[of(10, 0.8, 0.2)]), (0.8, angle), 10);
    // Backwards the same turn is by the other angle; at rest the last one is held.
    assert_sample(
        samples(&mut intake, &[of(20, -0.8, 0.2)]),
        (-0.8, -angle),
        20,
    );
    assert_sample(
        samples(&mut intake, &[of(30, 0.0, 0.01)]),
        (0.0, -angle),
        30,
    );
    assert!(intake.steers_by_turn() && intake.unstamped().is_empty());
}

#[test]
fn velocities_with_covariance_and_reports_tell_speed_and_turn() {
    let twist = Cdr::default().header(10, "base_link");
    let twist = twist.f64s(&[0.8, 0.0, 0.0, 0.0, 0.0, 0.2]).f64s(&[0.1; 36]);
    let angle = (1.2 * 0.2 / 0.8_f64).atan();
    let of = MessageType::TwistWithCovarianceStamped;
    assert_sample(
        samples(&mut intake(""), &[whole(of, twist)]),
        (0.8, angle),
        10,
    );
}

#[test]
fn autoware_reports_are_paired() {
    let angle = Cdr::default().stamp(10).f32s(&[0.25]);
    let velocity = Cdr::default()
        .header(10, "base_link")
        .f32s(&[1.5, 0.0, 0.3]);
    let sent = [
        steering(MessageType::SteeringReport, angle),
        speed(MessageType::VelocityReport, velocity),
    ];
    assert_sample(samples(&mut intake(""), &sent), (1.5, 0.25), 10);
}

const TWO_STEERED: &str = "joints = { steering = 'front_left_steering_joint', \
    steering_right = 'front_right_steering_joint', wheels = ['rear_left_wheel_joint', \
    'rear_right_wheel_joint'], wheel_radius_m = 0.2 }";

/// Angles of a left and a right wheel on a track of 0.9 m, of the angle between them.
fn ackermann(centre_rad: f64) -> [f64; 2] {
    let cot = 1.0 / centre_rad.tan();
    [-1.0, 1.0].map(|side| (1.0 / (cot + side * 0.9 / 2.4)).atan())
}

fn joints(ms: u32, names: &[&str], positions: &[f64], velocities: &[f64]) -> Cdr {
    let to = Cdr::default().header(ms, "").strings(names);
    to.f64_sequence(positions)
        .f64_sequence(velocities)
        .f64_sequence(&[])
}

#[test]
fn two_steered_joints_are_the_wheel_between_them() {
    let [left, right] = ackermann(0.4);
    let names = [
        "rear_right_wheel_joint",
        "rear_left_wheel_joint",
        "front_right_steering_joint",
        "front_left_steering_joint",
    ];
    let message = joints(10, &names, &[0.0, 0.0, right, left], &[6.0, 4.0, 0.0, 0.0]);
    let sent = [whole(MessageType::JointState, message)];
    assert_sample(samples(&mut intake(TWO_STEERED), &sent), (1.0, 0.4), 10);
}

#[test]
fn joints_in_parts_on_one_topic_are_paired() {
    let streams = "joints = { steering = 'steer', wheels = ['wheel'], wheel_radius_m = 0.2 }";
    let wheel = |ms| {
        let message = joints(ms, &["wheel"], &[9.0], &[5.0]);
        whole(MessageType::JointState, message)
    };
    let steer = |ms, angle| {
        let message = joints(ms, &["steer"], &[angle], &[]);
        whole(MessageType::JointState, message)
    };
    let sent = [steer(10, 0.2), wheel(11), steer(30, 0.2)];
    assert_sample(samples(&mut intake(streams), &sent), (1.0, 0.2), 11);
    // One that never comes is named.
    let sent: Vec<Sent> = (0..900).map(wheel).collect();
    let sentence = samples(&mut intake(streams), &sent).unwrap_err();
    assert!(
        sentence.contains("in a row lack the steering"),
        "{sentence}"
    );
    // A message with a part of the wheels is wrong at once.
    let two = streams.replace("['wheel']", "['wheel', 'missing']");
    let sentence = samples(&mut intake(&two), &[wheel(1)]).unwrap_err();
    assert!(
        sentence.contains("lacks the joint \"missing\""),
        "{sentence}"
    );
}

#[test]
fn joints_with_all_their_interfaces_are_read_by_name() {
    let streams = "joints = { steering = 'steer', wheels = ['wheel'], wheel_radius_m = 0.2 }";
    let to = Cdr::default()
        .header(10, "")
        .strings(&["wheel", "steer"])
        .u32(2);
    let to = to
        .strings(&["position", "velocity"])
        .f64_sequence(&[7.0, 5.0]);
    let to = to
        .strings(&["velocity", "position"])
        .f64_sequence(&[0.1, 0.3]);
    let sent = [whole(MessageType::DynamicJointState, to)];
    assert_sample(samples(&mut intake(streams), &sent), (1.0, 0.3), 10);
}

#[test]
fn a_steering_controllers_status_is_measured_wheels() {
    let streams = "joints = { wheel_radius_m = 0.2 }";
    let [left, right] = ackermann(-0.35);
    let to = Cdr::default().header(10, "");
    let to = to.f64_sequence(&[]).f64_sequence(&[6.0, 4.0]);
    let to = to.f64_sequence(&[right, left]);
    // The commands differ from what is measured.
    let to = to.f64_sequence(&[50.0, 50.0]).f64_sequence(&[0.9, 0.9]);
    let sent = [whole(MessageType::SteeringControllerStatus, to)];
    assert_sample(samples(&mut intake(streams), &sent), (1.0, -0.35), 10);
    let empty = Cdr::default().header(10, "").f64_sequence(&[1.0, 1.0]);
    let empty = empty.f64_sequence(&[]).f64_sequence(&[0.1]);
    let empty = empty.f64_sequence(&[]).f64_sequence(&[]);
    let sent = [whole(MessageType::SteeringControllerStatus, empty)];
    let sentence = samples(&mut intake(streams), &sent).unwrap_err();
    assert!(
        sentence.contains("traction_wheels_velocity is empty"),
        "{sentence}"
    );
}

#[test]
fn a_vesc_and_its_servo_are_read_by_their_gains() {
    // speed_to_erpm_gain 4614; steering_angle_to_servo_gain -1.2135, offset 0.5304.
    let streams = "steering_gear = -0.8240626\nsteering_zero = 0.5304\nspeed_gear = 2.1673169e-4";
    let mut intake = intake(streams);
    let servo = Cdr::default().f64s(&[0.5304 - 1.2135 * 0.3]);
    let state = Cdr::default()
        .header(10, "")
        .f64s(&[30.0, 25.0, 4.0, 2.0, 0.0, 0.0, 0.2]);
    let state = state
        .f64s(&[4614.0, 12.0, 0.1, 0.0, 1.2, 0.0])
        .i32s(&[100, 200, 0]);
    let state = state.f64s(&[0.0]).i32s(&[7]).f64s(&[0.0; 5]);
    let sent = [
        steering(MessageType::Float64, servo),
        speed(MessageType::VescStateStamped, state),
    ];
    // The servo is stamped a hundred seconds later, when it arrives: they are no pair.
    assert_eq!(samples(&mut intake, &sent).unwrap(), []);
    assert_eq!(intake.unstamped(), [Stream::Steering]);
    let halves = [
        steering(
            MessageType::Float64,
            Cdr::default().f64s(&[0.5304 - 1.2135 * 0.3]),
        ),
        speed(MessageType::Float32, Cdr::default().f32s(&[4614.0])),
    ];
    assert_sample(samples(&mut intake, &halves), (1.0, 0.3), 100_000);
    assert_eq!(intake.unstamped(), [Stream::Steering, Stream::Speed]);
}

#[test]
fn an_ackermann_drive_without_a_stamp_is_of_its_arrival() {
    let message = Cdr::default().f32s(&[0.25, 0.0, 1.5, 0.0, 0.0]);
    let sent = [whole(MessageType::AckermannDrive, message)];
    let mut intake = intake("");
    assert_sample(samples(&mut intake, &sent), (1.5, 0.25), 100_000);
    assert_eq!(intake.unstamped(), [Stream::WheelOdometry]);
}

#[test]
fn gears_are_of_every_type() {
    let streams = "steering_gear = -0.5\nspeed_gear = 0.2777777777777778";
    let stamped = Cdr::default()
        .header(10, "base")
        .f32s(&[0.5, 0.0, 3.6, 0.0, 0.0]);
    let sent = [whole(MessageType::AckermannDriveStamped, stamped)];
    assert_sample(samples(&mut intake(streams), &sent), (1.0, -0.25), 10);
    let report = Cdr::default().stamp(10).f32s(&[0.5]);
    let sent = [
        steering(MessageType::SteeringReport, report),
        speed(MessageType::Odometry, odometry(10, 3.6, 0.0)),
    ];
    assert_sample(samples(&mut intake(streams), &sent), (1.0, -0.25), 10);
}

fn scan(intake: &mut Intake, of: MessageType, payload: Cdr) -> Vec<Event> {
    let payload = payload.payload();
    let message = ReadMessage {
        stream: Stream::Scan,
        form: Form {
            message_type: Some(of),
            ..Form::default()
        },
        payload: &payload,
        arrived: ARRIVED,
    };
    let taken = intake.take(&message).unwrap();
    taken
        .events
        .into_iter()
        .map(|decoded| decoded.event)
        .collect()
}

#[test]
fn the_first_of_several_echoes_is_used() {
    let to = Cdr::default().header(10, "laser");
    let to = to.f32s(&[-0.5, 0.5, 0.5, 1e-3, 0.1, 0.05, 30.0]).u32(3);
    let to = to
        .f32_sequence(&[2.0, 3.0])
        .f32_sequence(&[])
        .f32_sequence(&[4.0]);
    let to = to.u32(3).f32_sequence(&[100.0, 50.0]);
    let to = to.f32_sequence(&[]).f32_sequence(&[70.0]);
    let events = scan(&mut intake(""), MessageType::MultiEchoLaserScan, to);
    let [Event::Scan(scan)] = events.as_slice() else {
        panic!("a scan: {events:?}");
    };
    assert_eq!(scan.ranges_m(), [2.0, f32::INFINITY, 4.0]);
}

#[test]
fn a_scan_of_more_beams_than_are_taken_is_thinned() {
    let beams = 25_200_usize;
    let step = std::f32::consts::TAU / beams as f32;
    let last = -std::f32::consts::PI + step * (beams - 1) as f32;
    let ranges: Vec<f32> = (0..beams).map(|beam| 1.0 + beam as f32 * 1e-4).collect();
    let to = Cdr::default().header(10, "laser");
    let to = to.f32s(&[-std::f32::consts::PI, last, step, 0.1 / beams as f32]);
    let to = to.f32s(&[0.1, 0.05, 60.0]).f32_sequence(&ranges).u32(0);
    let events = scan(&mut intake(""), MessageType::LaserScan, to);
    let [Event::Scan(scan)] = events.as_slice() else {
        panic!("a scan: {events:?}");
    };
    assert_eq!(scan.ranges_m().len(), 12_600);
    assert_eq!(scan.ranges_m().get(7), ranges.get(14));
    let shape = scan.shape();
    assert!((shape.angle_increment_rad - 2.0 * f64::from(step)).abs() < 1e-12);
    assert!((shape.time_increment_s * 12_600.0 - 0.1).abs() < 1e-6);
}
