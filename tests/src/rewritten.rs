//! Recordings made of others: other topics, other messages, the same drive.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use fleetcal_proto::ros::{
    AckermannDriveStamped, DriveSamples, JointState, MeasuredDrive, Odometry, PoseStamped,
    RosMessage, Time, TwistStamped,
};
use fleetcal_robot::recording::{RecordedMessage, Recording};
use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};

/// Message that replaces another.
#[derive(Debug, Clone, PartialEq)]
pub struct Rewritten {
    /// Its topic.
    pub topic: String,
    /// Its ROS 2 type.
    pub message_type: String,
    /// Log time, ns.
    pub log_time_ns: u64,
    /// Its bytes.
    pub payload: Vec<u8>,
}

impl Rewritten {
    /// Makes the unchanged message.
    pub fn unchanged(message_type: &str, of: &RecordedMessage) -> Self {
        Self {
            topic: of.topic.to_string(),
            message_type: message_type.to_owned(),
            log_time_ns: of.log_time_ns,
            payload: of.payload.clone(),
        }
    }

    /// Makes a message on another topic, with the log time of its source.
    pub fn on<M: RosMessage>(topic: &str, of: &RecordedMessage, message: &M) -> Self {
        Self {
            topic: topic.to_owned(),
            message_type: M::TYPE.to_owned(),
            log_time_ns: of.log_time_ns,
            payload: message.to_cdr(),
        }
    }
}

/// Writes a recording again as `path`: each message, with its type, is replaced by the result of
/// `rewrite`.
///
/// # Panics
/// When it cannot be read or written.
pub fn rewritten(
    recording: &Path,
    path: &Path,
    mut rewrite: impl FnMut(&str, &RecordedMessage) -> Vec<Rewritten>,
) {
    let recording = Recording::open(recording).expect("a recording");
    let file = BufWriter::new(File::create(path).expect("a file"));
    let mut writer = WriteOptions::new()
        .profile("ros2")
        .create(file)
        .expect("a recording");
    let types: BTreeMap<&str, &str> = recording
        .channels()
        .iter()
        .map(|channel| (channel.topic.as_str(), channel.message_type.as_str()))
        .collect();
    let topics: Vec<&str> = types.keys().copied().collect();
    let mut channels = BTreeMap::new();
    for message in recording.messages(&topics).expect("readable") {
        let message = message.expect("readable");
        let message_type = types.get(&*message.topic).expect("a topic of it");
        for written in rewrite(message_type, &message) {
            let channel_id = *channels
                .entry((written.topic.clone(), written.message_type.clone()))
                .or_insert_with_key(|(topic, of)| add_channel(&mut writer, topic, of));
            let header = MessageHeader {
                channel_id,
                sequence: 0,
                log_time: written.log_time_ns,
                publish_time: written.log_time_ns,
            };
            let written = writer.write_to_known_channel(&header, &written.payload);
            written.expect("written");
        }
    }
    writer.finish().expect("written");
}

fn add_channel(writer: &mut Writer<BufWriter<File>>, topic: &str, message_type: &str) -> u16 {
    let schema = writer.add_schema(message_type, "ros2msg", b"");
    let schema = schema.expect("a schema");
    let channel = writer.add_channel(schema, topic, "cdr", &BTreeMap::new());
    channel.expect("a channel")
}

/// Writes a recording with one of its topics under another name.
///
/// # Panics
/// When it cannot be read or written.
pub fn renamed(recording: &Path, path: &Path, from: &str, to: &str) {
    rewritten(recording, path, |message_type, of| {
        let mut message = Rewritten::unchanged(message_type, of);
        if message.topic == from {
            to.clone_into(&mut message.topic);
        }
        vec![message]
    });
}

/// Writes a simulated robot's recording with ten drive samples in each message.
///
/// # Panics
/// When it cannot be read or written.
pub fn together(recording: &Path, path: &Path) {
    let mut waiting = Vec::new();
    rewritten(recording, path, |message_type, of| {
        if message_type != AckermannDriveStamped::TYPE {
            return vec![Rewritten::unchanged(message_type, of)];
        }
        let drive = AckermannDriveStamped::from_cdr(&of.payload).expect("a drive sample");
        waiting.push(MeasuredDrive {
            stamp: drive.header.stamp,
            steering_angle: drive.drive.steering_angle,
            speed: drive.drive.speed,
        });
        if waiting.len() < 10 {
            return Vec::new();
        }
        let samples = DriveSamples::new(std::mem::take(&mut waiting)).expect("100 ms");
        vec![Rewritten::on("/tugger_01/wheel_odometry", of, &samples)]
    });
}

/// Messages of a robot instead of `AckermannDriveStamped`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DriveAs {
    /// `/tugger_01/joint_states` with steering and both rear wheels.
    Joints,
    /// `/tugger_01/joint_states` with the steering, `/tugger_01/odom` with the speed.
    JointsAndOdometry,
    /// The same topics at 50 Hz, and `/tugger_01/twist`, neither at the other's stamps.
    SlowJointsAndTwist,
}

/// Joints of these robots, in the form of `streams.joints`.
pub const JOINTS: &str = "{ steering = 'steer', steering_gear = 0.5, wheels = ['left', 'right'], \
                          wheel_radius_m = 0.25 }";

/// Writes a simulated robot's recording with its drive as other messages. Gear and radius are
/// powers of two, so that no digit is lost.
///
/// # Panics
/// When it cannot be read or written.
pub fn driven(recording: &Path, path: &Path, how: DriveAs) {
    let mut samples = 0_u32;
    let mut last_angle_rad = 0.0;
    rewritten(recording, path, |message_type, of| {
        if message_type != AckermannDriveStamped::TYPE {
            return vec![Rewritten::unchanged(message_type, of)];
        }
        let drive = AckermannDriveStamped::from_cdr(&of.payload).expect("a drive sample");
        let (angle_rad, speed_mps) = (drive.drive.steering_angle, drive.drive.speed);
        let (angle_rad, speed_mps) = (f64::from(angle_rad), f64::from(speed_mps));
        let wheel_radps = speed_mps / 0.25;
        let mut joints = JointState {
            header: drive.header.clone(),
            name: ["left", "steer", "right"].map(str::to_owned).to_vec(),
            position: vec![0.0, 2.0 * angle_rad, 0.0],
            velocity: vec![wheel_radps, 0.0, wheel_radps],
            effort: Vec::new(),
        };
        let mut odometry = Odometry {
            header: drive.header.clone(),
            ..Odometry::default()
        };
        odometry.twist.twist.linear.x = speed_mps;
        samples += 1;
        let steering = |joints: &JointState| Rewritten::on("/tugger_01/joint_states", of, joints);
        let written = match how {
            DriveAs::Joints => vec![steering(&joints)],
            DriveAs::JointsAndOdometry => vec![
                steering(&joints),
                Rewritten::on("/tugger_01/odom", of, &odometry),
            ],
            DriveAs::SlowJointsAndTwist => {
                let mut twist = TwistStamped {
                    header: drive.header.clone(),
                    ..TwistStamped::default()
                };
                twist.twist.linear.x = speed_mps;
                let mut written = vec![Rewritten::on("/tugger_01/twist", of, &twist)];
                if samples.is_multiple_of(2) {
                    // Half a sample earlier the angle was half-way to the last one.
                    let stamp_ns = drive.header.stamp.as_ns() - 5_000_000;
                    joints.header.stamp = Time::from_ns(stamp_ns).expect("a time after 1970");
                    let middle_rad = 0.5 * (angle_rad + last_angle_rad);
                    joints.position = vec![0.0, 2.0 * middle_rad, 0.0];
                    written.push(steering(&joints));
                }
                written
            }
        };
        last_angle_rad = angle_rad;
        written
    });
}

/// Writes a recording without its scans, its true poses as those of a LiDAR at the rear axle, as
/// `PoseStamped` and as `Odometry`.
///
/// # Panics
/// When it cannot be read or written.
pub fn posed(recording: &Path, path: &Path) {
    rewritten(recording, path, |message_type, of| match message_type {
        AckermannDriveStamped::TYPE => vec![Rewritten::unchanged(message_type, of)],
        PoseStamped::TYPE => {
            let pose = PoseStamped::from_cdr(&of.payload).expect("a pose");
            let mut odometry = Odometry {
                header: pose.header.clone(),
                ..Odometry::default()
            };
            odometry.pose.pose = pose.pose;
            vec![
                Rewritten::on("/tugger_01/lidar_pose", of, &pose),
                Rewritten::on("/tugger_01/lidar_odometry", of, &odometry),
            ]
        }
        _ => Vec::new(),
    });
}
