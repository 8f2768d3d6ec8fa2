//! Reading of the ROS 2 messages that a stream may be made of: the one place that goes from a stream
//! and a message type to what the estimator takes, live and of recordings.

use fleetcal_domain::robot::{RobotConfig, ScanSettings};
use fleetcal_domain::streams::RobotStreams;
use fleetcal_estimator::{DriveSample, Event, LidarPose, RobotTime, Scan, Vehicle};
use fleetcal_model::Stream;
use fleetcal_proto::message_type::{Form, MessageType};
use fleetcal_proto::ros::{
    DriveSamples, Header, LaserScan, MultiEchoLaserScan, Odometry, PointCloud2, PoseStamped,
    RosMessage, Unstated,
};

use crate::cloud;
use crate::decode::{self, Decoded, MessageRefused};
use crate::sighting::{Sighted, Sighting};

/// Slowest speed at which a yaw rate tells a steering angle, m/s: below, it is divided by noise.
pub const STEERING_BY_TURN_MIN_MPS: f64 = 0.05;

/// Settings for reading a robot's messages where these do not name their own type.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReadingSettings {
    /// Settings of its scans.
    pub scans: ScanSettings,
    /// Its topics and joints.
    pub streams: RobotStreams,
    /// The vehicle, for messages that state its turning instead of its steering; without it they are
    /// refused.
    pub vehicle: Option<Vehicle>,
}

impl ReadingSettings {
    /// Returns the settings of a robot.
    pub fn of(config: &RobotConfig) -> Self {
        Self {
            scans: config.scans(),
            streams: config.streams.clone(),
            vehicle: Some(config.vehicle()),
        }
    }

    /// Returns the type of a stream's messages: as they name it, else as configured, else the usual
    /// one.
    pub fn message_type(&self, stream: Stream, form: Form) -> Option<MessageType> {
        let usual = || match stream {
            Stream::Scan => Some(self.scans.scan_type.message_type()),
            _ => MessageType::of_stream(stream).first().copied(),
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
    /// A speed of the rear axle and a yaw rate, rad/s, which tell the steering angle.
    Turn {
        /// The speed.
        speed: Half,
        /// The yaw rate.
        yaw_rate_radps: f64,
        /// The vehicle that turns.
        vehicle: Vehicle,
    },
}

/// Message of a robot with the context to read it.
#[derive(Debug, Clone, Copy)]
pub struct Message<'m> {
    /// Stream of the message.
    pub stream: Stream,
    /// Encoding and type of the message.
    pub form: Form,
    /// Its bytes.
    pub payload: &'m [u8],
    /// Time of its arrival, which is the stamp of a message without one.
    pub arrived: RobotTime,
}

/// Message as it was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Read {
    /// Its content.
    pub reading: Reading,
    /// False for a message without a stamp.
    pub is_stamped: bool,
}

/// Steering, speed and turn of a message, in radians and metres a second.
struct Wheels {
    header: Option<Header>,
    steering: Result<f64, MessageRefused>,
    speed: Result<f64, MessageRefused>,
    yaw_rate_radps: Option<f64>,
    /// True if another message of the topic may state the missing angle,
    steering_may_follow: bool,
    /// or the missing speed.
    speed_may_follow: bool,
}

impl Message<'_> {
    /// Reads the message, by the type that it names, else the configured one, else the usual one.
    ///
    /// # Errors
    /// One sentence: the stream, the field, its value and the accepted values.
    pub fn read(&self, settings: &ReadingSettings) -> Result<Read, MessageRefused> {
        let whole = |(stamp, event)| Read {
            reading: Reading::Whole(Decoded {
                stamp,
                event,
                note: None,
            }),
            is_stamped: true,
        };
        let stream = self.stream;
        if stream == Stream::Event {
            let reading = decode::event(self.payload).map(Reading::Whole)?;
            let is_stamped = true;
            return Ok(Read {
                reading,
                is_stamped,
            });
        }
        let of = self.of_stream(settings)?;
        match stream {
            Stream::Scan => {
                let scan = self.scan(of, settings)?;
                Ok(whole((scan.stamp(), Event::Scan(scan))))
            }
            Stream::LidarOdometry => {
                let pose = self.pose(of)?;
                Ok(whole((pose.stamp(), Event::LidarPose(pose))))
            }
            Stream::WheelOdometry if of == MessageType::DriveSamples => {
                let units = settings.streams.units();
                let samples = decode::drive_samples(&self.decoded()?, &units)?;
                Ok(Read {
                    reading: Reading::Samples(samples),
                    is_stamped: true,
                })
            }
            _ => {
                let wheels = self.wheels(of, settings)?;
                let is_stamped = wheels.header.is_some();
                let reading = self.drive(wheels, settings)?;
                Ok(Read {
                    reading,
                    is_stamped,
                })
            }
        }
    }

    /// Returns the message's type, which its stream must accept.
    fn of_stream(&self, settings: &ReadingSettings) -> Result<MessageType, MessageRefused> {
        let stream = self.stream;
        let accepted = MessageType::of_stream(stream);
        match settings.message_type(stream, self.form) {
            Some(of) if accepted.contains(&of) => Ok(of),
            Some(of) => Err(MessageRefused::of_type(stream, of)),
            None => Err(MessageRefused::NoJoints { stream }),
        }
    }

    fn decoded<M: RosMessage>(&self) -> Result<M, MessageRefused> {
        let stream = self.stream;
        M::decode(self.form.encoding, self.payload)
            .map_err(|source| MessageRefused::Payload { stream, source })
    }

    fn scan(&self, of: MessageType, settings: &ReadingSettings) -> Result<Scan, MessageRefused> {
        match of {
            MessageType::LaserScan => decode::scan(self.decoded()?),
            MessageType::MultiEchoLaserScan => {
                let message: MultiEchoLaserScan = self.decoded()?;
                decode::scan(message.first_echoes())
            }
            MessageType::PointCloud2 => {
                let message: PointCloud2 = self.decoded()?;
                Ok(cloud::scan(&message, &settings.scans.band)?)
            }
            other => Err(MessageRefused::of_type(self.stream, other)),
        }
    }

    fn pose(&self, of: MessageType) -> Result<LidarPose, MessageRefused> {
        match of {
            MessageType::Odometry => decode::lidar_pose(&self.decoded()?),
            MessageType::PoseStamped => {
                let message: PoseStamped = self.decoded()?;
                decode::pose_in_odom(&message.header, &message.pose, None)
            }
            other => Err(MessageRefused::of_type(self.stream, other)),
        }
    }

    fn wheels(
        &self,
        of: MessageType,
        settings: &ReadingSettings,
    ) -> Result<Wheels, MessageRefused> {
        let (stream, units) = (self.stream, settings.streams.units());
        let stated = of
            .wheels(self.form.encoding, self.payload, settings.streams.joints())
            .map_err(|source| MessageRefused::Payload { stream, source })?
            .ok_or_else(|| MessageRefused::of_type(stream, of))?;
        let unstated = |unstated| MessageRefused::of_wheels(stream, of, unstated);
        let follows = |of: &Result<f64, Unstated>| of.as_ref().is_err_and(Unstated::may_follow);
        Ok(Wheels {
            steering_may_follow: follows(&stated.steering),
            speed_may_follow: follows(&stated.speed),
            header: stated.header,
            steering: stated
                .steering
                .map(|sent| units.steering_rad(sent))
                .map_err(unstated),
            speed: stated
                .speed
                .map(|sent| units.speed_mps(sent))
                .map_err(unstated),
            yaw_rate_radps: stated.yaw_rate_radps,
        })
    }

    fn drive(&self, wheels: Wheels, settings: &ReadingSettings) -> Result<Reading, MessageRefused> {
        let stamp = wheels
            .header
            .map_or(self.arrived, |of| RobotTime(of.stamp.as_ns()));
        let steering = |value| {
            let sample = self.sample(stamp, 0.0, value)?;
            let stamp = sample.stamp();
            Ok(Reading::Steering(Half { stamp, value }))
        };
        let speed = |value| {
            let sample = self.sample(stamp, value, 0.0)?;
            let stamp = sample.stamp();
            Ok(Reading::Speed(Half { stamp, value }))
        };
        match (self.stream, wheels.steering, wheels.speed) {
            (Stream::Steering, angle, _) => steering(angle?),
            (Stream::Speed, _, value) => speed(value?),
            (_, Ok(angle_rad), Ok(speed_mps)) => {
                let sample = self.sample(stamp, speed_mps, angle_rad)?;
                Ok(Reading::Whole(Decoded {
                    stamp: sample.stamp(),
                    event: Event::WheelOdometry(sample),
                    note: None,
                }))
            }
            (stream, Err(refused), Ok(value)) => match (wheels.yaw_rate_radps, settings.vehicle) {
                (Some(yaw_rate_radps), Some(vehicle)) => {
                    let stamp = self.sample(stamp, value, 0.0)?.stamp();
                    let speed = Half { stamp, value };
                    if !yaw_rate_radps.is_finite() {
                        return Err(MessageRefused::YawRate(stream, yaw_rate_radps));
                    }
                    Ok(Reading::Turn {
                        speed,
                        yaw_rate_radps,
                        vehicle,
                    })
                }
                _ if wheels.steering_may_follow => speed(value),
                _ => Err(refused),
            },
            (_, Ok(value), Err(_)) if wheels.speed_may_follow => steering(value),
            // Of joints that are there in part, the missing one is named.
            (_, Err(_), Err(refused)) if wheels.steering_may_follow && !wheels.speed_may_follow => {
                Err(refused)
            }
            (_, Err(refused), Err(_)) | (_, Ok(_), Err(refused)) => Err(refused),
        }
    }

    /// Returns the unchecked content; `None` if the payload cannot be decoded or is a note.
    pub fn sight(&self, settings: &ReadingSettings) -> Option<Sighting> {
        self.sighting(settings).ok()
    }

    fn sighting(&self, settings: &ReadingSettings) -> Result<Sighting, MessageRefused> {
        let of = self.of_stream(settings)?;
        let scan = |header: &Header, scan_time: f32| {
            let scan_time_s = f64::from(scan_time);
            Sighting::of(header, Sighted::Scan { scan_time_s })
        };
        Ok(match (self.stream, of) {
            (Stream::Scan, MessageType::LaserScan) => {
                let message: LaserScan = self.decoded()?;
                scan(&message.header, message.scan_time)
            }
            (Stream::Scan, MessageType::MultiEchoLaserScan) => {
                let message: MultiEchoLaserScan = self.decoded()?;
                scan(&message.header, message.scan_time)
            }
            (Stream::Scan, _) => {
                let message: PointCloud2 = self.decoded()?;
                scan(&message.header, 0.0)
            }
            (Stream::LidarOdometry, MessageType::PoseStamped) => {
                let message: PoseStamped = self.decoded()?;
                Sighting::of_pose(&message.header, None, &message.pose)
            }
            (Stream::LidarOdometry, _) => {
                let message: Odometry = self.decoded()?;
                let child_frame = Some(message.child_frame_id.as_str());
                Sighting::of_pose(&message.header, child_frame, &message.pose.pose)
            }
            (Stream::WheelOdometry, MessageType::DriveSamples) => {
                let message: DriveSamples = self.decoded()?;
                Sighting::of_samples(message.samples(), &settings.streams.units())
            }
            _ => self.sighted_wheels(of, settings)?,
        })
    }

    fn sighted_wheels(
        &self,
        of: MessageType,
        settings: &ReadingSettings,
    ) -> Result<Sighting, MessageRefused> {
        let wheels = self.wheels(of, settings)?;
        let (speed, steering) = match self.stream {
            Stream::Steering => (None, Some(wheels.steering?)),
            Stream::Speed => (Some(wheels.speed?), None),
            _ => match (wheels.speed, wheels.steering) {
                (Ok(speed), Ok(steering)) => (Some(speed), Some(steering)),
                (Ok(speed), Err(refused)) => match (wheels.yaw_rate_radps, settings.vehicle) {
                    (Some(yaw_rate_radps), Some(vehicle)) => {
                        let (speed, angle) = vehicle.reading_of(speed, yaw_rate_radps);
                        (Some(speed), Some(angle))
                    }
                    _ if wheels.steering_may_follow => (Some(speed), None),
                    _ => return Err(refused),
                },
                (Err(_), Ok(steering)) if wheels.speed_may_follow => (None, Some(steering)),
                (Err(refused), _) => return Err(refused),
            },
        };
        let sighting = |header: &Header| Sighting::of_wheels(header, speed, steering);
        Ok(match &wheels.header {
            Some(header) => sighting(header),
            None => Sighting {
                stamp: self.arrived,
                ..sighting(&Header::default())
            },
        })
    }

    fn sample(
        &self,
        stamp: RobotTime,
        speed_mps: f64,
        angle_rad: f64,
    ) -> Result<DriveSample, MessageRefused> {
        let stream = self.stream;
        DriveSample::new(stamp, speed_mps, angle_rad)
            .map_err(|source| MessageRefused::Field { stream, source })
    }
}

/// Reading of single messages, for tests.
#[cfg(test)]
pub mod testing {
    use super::*;

    /// Reads a message by the usual settings.
    pub fn decoded(stream: Stream, form: Form, payload: &[u8]) -> Result<Decoded, MessageRefused> {
        decoded_by(&ReadingSettings::default(), stream, form, payload)
    }

    /// Reads a message.
    pub fn decoded_by(
        settings: &ReadingSettings,
        stream: Stream,
        form: Form,
        payload: &[u8],
    ) -> Result<Decoded, MessageRefused> {
        let arrived = RobotTime(0);
        let message = Message {
            stream,
            form,
            payload,
            arrived,
        };
        match message.read(settings)?.reading {
            Reading::Whole(decoded) => Ok(decoded),
            half => panic!("half of a sample: {half:?}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use fleetcal_proto::ros::{
        AckermannDrive, AckermannDriveStamped, JointState, Pose, Quaternion, Time, TwistStamped,
    };

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
        read(stream, form, settings, &message.to_cdr())
    }

    fn read(
        stream: Stream,
        form: Form,
        settings: &ReadingSettings,
        payload: &[u8],
    ) -> Result<Reading, String> {
        let message = Message {
            stream,
            form,
            payload,
            arrived: RobotTime(1_800_000_000_000_000_000),
        };
        let read = message
            .read(settings)
            .map_err(|refused| refused.to_string())?;
        Ok(read.reading)
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
