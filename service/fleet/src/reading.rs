//! Reading of the ROS 2 messages that a stream may be made of, for a robot's task.

use fleetcal_domain::robot::{RobotConfig, ScanSettings};
use fleetcal_domain::streams::{Joints, RobotStreams, message_types};
use fleetcal_estimator::{DriveSample, Event, RobotTime};
use fleetcal_model::Stream;
use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::message_type::{Form, MessageType};
use fleetcal_proto::ros::{
    AckermannDriveStamped, DriveSamples, Header, JointState, LaserScan, Odometry, PointCloud2,
    PoseStamped, RosMessage, TwistStamped,
};

use crate::decode::{self, Decoded, MessageRefused};
use crate::sighting::{Sighted, Sighting};

/// Settings for reading a robot's messages where these do not name their own type.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReadingSettings {
    /// Settings of its scans.
    pub scans: ScanSettings,
    /// Its topics and joints.
    pub streams: RobotStreams,
}

impl ReadingSettings {
    /// Returns the settings of a robot.
    pub fn of(config: &RobotConfig) -> Self {
        Self {
            scans: config.scans(),
            streams: config.streams.clone(),
        }
    }

    /// Returns the type of a stream's messages: as they name it, else as configured, else the usual
    /// one.
    pub fn message_type(&self, stream: Stream, form: Form) -> Option<MessageType> {
        let usual = || match stream {
            Stream::Scan => Some(self.scans.scan_type.message_type()),
            _ => message_types(stream).first().copied(),
        };
        let configured = self.streams.message_type(stream);
        form.message_type.or(configured).or_else(usual)
    }
}

/// Half of a drive sample: a steering angle, rad, or a speed, m/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Half {
    /// Stamp of the measurement.
    pub stamp: RobotTime,
    /// Angle or speed.
    pub value: f64,
}

/// Content of a message.
#[derive(Debug, Clone, PartialEq)]
pub enum Reading {
    /// Complete content for the estimator.
    Whole(Decoded),
    /// Drive samples in the order of their stamps, at least one.
    Samples(Vec<DriveSample>),
    /// A steering angle that waits for its speed.
    Steering(Half),
    /// A speed that waits for its steering angle.
    Speed(Half),
}

/// Reads one payload, by the type that the message names, else the configured one, else the usual
/// one.
///
/// # Errors
/// One sentence: the stream, the field, its value and the accepted values.
pub fn read(
    stream: Stream,
    form: Form,
    settings: &ReadingSettings,
    payload: &[u8],
) -> Result<Reading, MessageRefused> {
    let of = settings.message_type(stream, form);
    let form = Form {
        message_type: of,
        ..form
    };
    let message = Message {
        stream,
        encoding: form.encoding,
        payload,
        joints: settings.streams.joints(),
    };
    match (stream, of) {
        (Stream::Steering, Some(of)) => message.steering(of).map(Reading::Steering),
        (Stream::Speed, Some(of)) => message.speed(of).map(Reading::Speed),
        (Stream::WheelOdometry, Some(MessageType::JointState)) => {
            message.drive().map(Reading::Whole)
        }
        (Stream::WheelOdometry, Some(MessageType::DriveSamples)) => {
            decode::drive_samples(&message.decoded()?).map(Reading::Samples)
        }
        (Stream::LidarOdometry, Some(MessageType::PoseStamped)) => {
            message.pose().map(Reading::Whole)
        }
        (Stream::WheelOdometry | Stream::LidarOdometry, Some(of))
            if !message_types(stream).contains(&of) =>
        {
            Err(MessageRefused::of_type(stream, of))
        }
        _ => decode::decode(stream, form, &settings.scans, payload).map(Reading::Whole),
    }
}

/// Returns the unchecked content of a payload; `None` if it cannot be decoded or is a note.
pub fn sight(
    stream: Stream,
    form: Form,
    settings: &ReadingSettings,
    payload: &[u8],
) -> Option<Sighting> {
    let of = settings.message_type(stream, form)?;
    let message = Message {
        stream,
        encoding: form.encoding,
        payload,
        joints: settings.streams.joints(),
    };
    message.sighting(of).ok()
}

/// Payload with the context to read it.
struct Message<'m> {
    stream: Stream,
    encoding: Encoding,
    payload: &'m [u8],
    joints: Option<&'m Joints>,
}

impl Message<'_> {
    fn decoded<M: RosMessage>(&self) -> Result<M, MessageRefused> {
        let stream = self.stream;
        M::decode(self.encoding, self.payload)
            .map_err(|source| MessageRefused::Payload { stream, source })
    }

    /// The steering angle as it was sent.
    fn sent_steering(&self, of: MessageType) -> Result<(Header, f64), MessageRefused> {
        Ok(match of {
            MessageType::JointState => {
                let message: JointState = self.decoded()?;
                let angle_rad = self.steering_of(&message)?;
                (message.header, angle_rad)
            }
            MessageType::AckermannDriveStamped => {
                let message: AckermannDriveStamped = self.decoded()?;
                (message.header, f64::from(message.drive.steering_angle))
            }
            other => return Err(MessageRefused::of_type(self.stream, other)),
        })
    }

    /// The speed as it was sent.
    fn sent_speed(&self, of: MessageType) -> Result<(Header, f64), MessageRefused> {
        Ok(match of {
            MessageType::Odometry => {
                let message: Odometry = self.decoded()?;
                (message.header, message.twist.twist.linear.x)
            }
            MessageType::TwistStamped => {
                let message: TwistStamped = self.decoded()?;
                (message.header, message.twist.linear.x)
            }
            MessageType::JointState => {
                let message: JointState = self.decoded()?;
                let speed_mps = self.speed_of(&message)?;
                (message.header, speed_mps)
            }
            MessageType::AckermannDriveStamped => {
                let message: AckermannDriveStamped = self.decoded()?;
                (message.header, f64::from(message.drive.speed))
            }
            other => return Err(MessageRefused::of_type(self.stream, other)),
        })
    }

    fn steering(&self, of: MessageType) -> Result<Half, MessageRefused> {
        let (header, angle_rad) = self.sent_steering(of)?;
        let sample = self.sample(&header, 0.0, angle_rad)?;
        Ok(Half {
            stamp: sample.stamp(),
            value: angle_rad,
        })
    }

    fn speed(&self, of: MessageType) -> Result<Half, MessageRefused> {
        let (header, speed_mps) = self.sent_speed(of)?;
        let sample = self.sample(&header, speed_mps, 0.0)?;
        Ok(Half {
            stamp: sample.stamp(),
            value: speed_mps,
        })
    }

    fn drive(&self) -> Result<Decoded, MessageRefused> {
        let message: JointState = self.decoded()?;
        let (angle_rad, speed_mps) = (self.steering_of(&message)?, self.speed_of(&message)?);
        let sample = self.sample(&message.header, speed_mps, angle_rad)?;
        Ok(Decoded {
            stamp: sample.stamp(),
            event: Event::WheelOdometry(sample),
            note: None,
        })
    }

    fn sighting(&self, of: MessageType) -> Result<Sighting, MessageRefused> {
        Ok(match self.stream {
            Stream::Steering => {
                let (header, steering) = self.sent_steering(of)?;
                Sighting::of_wheels(&header, None, Some(steering))
            }
            Stream::Speed => {
                let (header, speed) = self.sent_speed(of)?;
                Sighting::of_wheels(&header, Some(speed), None)
            }
            Stream::WheelOdometry if of == MessageType::DriveSamples => {
                let message: DriveSamples = self.decoded()?;
                Sighting::of_samples(message.samples())
            }
            Stream::WheelOdometry if of == MessageType::JointState => {
                let message: JointState = self.decoded()?;
                let (speed, steering) = (self.speed_of(&message)?, self.steering_of(&message)?);
                Sighting::of_wheels(&message.header, Some(speed), Some(steering))
            }
            Stream::WheelOdometry if of == MessageType::AckermannDriveStamped => {
                let message: AckermannDriveStamped = self.decoded()?;
                let drive = message.drive;
                let (speed, steering) = (drive.speed.into(), drive.steering_angle.into());
                Sighting::of_wheels(&message.header, Some(speed), Some(steering))
            }
            Stream::WheelOdometry => return Err(MessageRefused::of_type(self.stream, of)),
            Stream::Scan if of == MessageType::LaserScan => {
                let message: LaserScan = self.decoded()?;
                let scan_time_s = f64::from(message.scan_time);
                Sighting::of(&message.header, Sighted::Scan { scan_time_s })
            }
            Stream::Scan => {
                let message: PointCloud2 = self.decoded()?;
                Sighting::of(&message.header, Sighted::Scan { scan_time_s: 0.0 })
            }
            Stream::LidarOdometry if of == MessageType::PoseStamped => {
                let message: PoseStamped = self.decoded()?;
                Sighting::of_pose(&message.header, &message.header.frame_id, &message.pose)
            }
            Stream::LidarOdometry => {
                let message: Odometry = self.decoded()?;
                Sighting::of_pose(&message.header, &message.child_frame_id, &message.pose.pose)
            }
            Stream::Event => {
                return Err(MessageRefused::Alone {
                    stream: Stream::Event,
                });
            }
        })
    }

    fn pose(&self) -> Result<Decoded, MessageRefused> {
        let message: PoseStamped = self.decoded()?;
        let pose = decode::pose_in_odom(&message.header, &message.pose, None)?;
        Ok(Decoded {
            stamp: pose.stamp(),
            event: Event::LidarPose(pose),
            note: None,
        })
    }

    fn joints(&self) -> Result<&Joints, MessageRefused> {
        let stream = self.stream;
        self.joints.ok_or(MessageRefused::NoJoints { stream })
    }

    fn steering_of(&self, message: &JointState) -> Result<f64, MessageRefused> {
        let joints = self.joints()?;
        let stream = self.stream;
        let joint = joints
            .steering
            .as_deref()
            .ok_or(MessageRefused::NoJoints { stream })?;
        let position = message.position_of(joint);
        let position_rad = position.ok_or_else(|| self.lacks(joint, "position"))?;
        Ok(joints.steering_gear * position_rad)
    }

    /// Returns the mean speed of the wheels, m/s.
    fn speed_of(&self, message: &JointState) -> Result<f64, MessageRefused> {
        let joints = self.joints()?;
        let stream = self.stream;
        let radius_m = joints.wheel_radius_m;
        let radius_m = radius_m.ok_or(MessageRefused::NoJoints { stream })?;
        let mut sum_radps = 0.0;
        for joint in &joints.wheels {
            let velocity = message.velocity_of(joint);
            sum_radps += velocity.ok_or_else(|| self.lacks(joint, "velocity"))?;
        }
        Ok(radius_m * joints.wheel_gear * sum_radps / joints.wheels.len().max(1) as f64)
    }

    fn lacks(&self, joint: &str, what: &'static str) -> MessageRefused {
        MessageRefused::Joint {
            stream: self.stream,
            joint: joint.to_owned(),
            what,
        }
    }

    fn sample(
        &self,
        header: &Header,
        speed_mps: f64,
        angle_rad: f64,
    ) -> Result<DriveSample, MessageRefused> {
        let stream = self.stream;
        DriveSample::new(RobotTime(header.stamp.as_ns()), speed_mps, angle_rad)
            .map_err(|source| MessageRefused::Field { stream, source })
    }
}

#[cfg(test)]
mod tests {
    use fleetcal_proto::ros::{AckermannDrive, Pose, Quaternion, Time};

    use super::*;

    fn header() -> Header {
        Header {
            stamp: Time {
                sec: 1_700_000_000,
                nanosec: 5,
            },
            frame_id: String::new(),
        }
    }

    fn settings(streams: &str) -> ReadingSettings {
        ReadingSettings {
            streams: toml::from_str(streams).unwrap(),
            ..ReadingSettings::default()
        }
    }

    const JOINTS: &str = "joints = { steering = 'steer', steering_gear = 0.5, \
                          wheels = ['left', 'right'], wheel_radius_m = 0.2, wheel_gear = 0.1 }\n";

    fn joint_state() -> JointState {
        JointState {
            header: header(),
            name: ["left", "steer", "right"].map(str::to_owned).to_vec(),
            position: vec![7.0, 0.4, 9.0],
            velocity: vec![40.0, 0.0, 60.0],
            effort: Vec::new(),
        }
    }

    fn read_as<M: RosMessage>(
        stream: Stream,
        settings: &ReadingSettings,
        message: &M,
    ) -> Result<Reading, String> {
        let form = Form {
            message_type: MessageType::of_ros_type(M::TYPE),
            ..Form::default()
        };
        read(stream, form, settings, &message.to_cdr()).map_err(|refused| refused.to_string())
    }

    #[test]
    fn joints_are_a_drive_sample_or_its_halves() {
        let settings = settings(JOINTS);
        let Ok(Reading::Whole(decoded)) = read_as(Stream::WheelOdometry, &settings, &joint_state())
        else {
            panic!("a drive sample");
        };
        let Event::WheelOdometry(sample) = decoded.event else {
            panic!("a drive sample");
        };
        assert!((sample.steering_rad() - 0.2).abs() < 1e-12);
        assert!((sample.speed_mps() - 1.0).abs() < 1e-12);
        let half = |value| Half {
            stamp: RobotTime(1_700_000_000_000_000_005),
            value,
        };
        assert_eq!(
            read_as(Stream::Steering, &settings, &joint_state()),
            Ok(Reading::Steering(half(sample.steering_rad())))
        );
        assert_eq!(
            read_as(Stream::Speed, &settings, &joint_state()),
            Ok(Reading::Speed(half(sample.speed_mps())))
        );
    }

    #[test]
    fn a_speed_comes_in_each_of_its_messages() {
        let settings = ReadingSettings::default();
        let mut odometry = Odometry {
            header: header(),
            ..Odometry::default()
        };
        odometry.twist.twist.linear.x = 1.5;
        let mut twist = TwistStamped {
            header: header(),
            ..TwistStamped::default()
        };
        twist.twist.linear.x = 1.5;
        let ackermann = AckermannDriveStamped {
            header: header(),
            drive: AckermannDrive {
                speed: 1.5,
                ..AckermannDrive::default()
            },
        };
        for read in [
            read_as(Stream::Speed, &settings, &odometry),
            read_as(Stream::Speed, &settings, &twist),
            read_as(Stream::Speed, &settings, &ackermann),
        ] {
            let Ok(Reading::Speed(half)) = read else {
                panic!("a speed: {read:?}");
            };
            assert!((half.value - 1.5).abs() < 1e-12);
        }
        // Odometry is what a speed is taken for when nobody says anything.
        let plain = Form::default();
        assert!(read(Stream::Speed, plain, &settings, &odometry.to_cdr()).is_ok());
    }

    #[test]
    fn a_lidar_pose_comes_as_pose_too() {
        let pose = Pose {
            orientation: Quaternion::from_yaw(0.3),
            ..Pose::default()
        };
        let message = PoseStamped {
            header: header(),
            pose,
        };
        let read = read_as(Stream::LidarOdometry, &ReadingSettings::default(), &message);
        let Ok(Reading::Whole(decoded)) = read else {
            panic!("a pose: {read:?}");
        };
        assert!(matches!(decoded.event, Event::LidarPose(_)));
    }

    #[test]
    fn each_refusal_says_what_is_accepted() {
        let plain = ReadingSettings::default();
        let reason = |read: Result<Reading, String>| read.expect_err("refused");
        for (refusal, wanted) in [
            (
                reason(read_as(Stream::WheelOdometry, &plain, &joint_state())),
                "streams.joints says which joints",
            ),
            (
                reason(read_as(
                    Stream::WheelOdometry,
                    &settings(&JOINTS.replace("'left'", "'front'")),
                    &joint_state(),
                )),
                "lacks the joint \"front\"",
            ),
            (
                reason(read_as(Stream::Scan, &plain, &joint_state())),
                "scan: type: got sensor_msgs/msg/JointState",
            ),
            (
                reason(read_as(Stream::LidarOdometry, &plain, &joint_state())),
                "expected nav_msgs/msg/Odometry and geometry_msgs/msg/PoseStamped",
            ),
            (
                reason(read_as(Stream::Speed, &plain, &PoseStamped::default())),
                "speed: type: got geometry_msgs/msg/PoseStamped",
            ),
            (
                reason(read_as(Stream::Speed, &plain, &Odometry::default())),
                "header.stamp",
            ),
        ] {
            assert!(refusal.contains(wanted), "{refusal}");
        }
    }
}
