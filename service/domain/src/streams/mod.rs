//! Topics of a robot's streams in ROS 2, and the types of its messages.

mod settings;

pub use fleetcal_proto::ros::{Joints, Units};
pub use settings::{Ros2Settings, TopicName};

use std::collections::BTreeSet;

use fleetcal_proto::message_type::MessageType;
use serde::{Deserialize, Serialize};

use fleetcal_model::Stream;

/// Longest name of a topic, and longest prefix, bytes.
const NAME_BYTES_MAX: usize = 200;

/// Topic and type of a stream.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Source {
    /// Name below the robot, without a slash at the ends.
    #[cfg_attr(feature = "openapi", schema(examples("front/scan")))]
    pub topic: TopicName,
    /// Message type, if keys, tokens and encodings do not state it.
    #[serde(rename = "type", default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false))]
    pub message_type: Option<MessageType>,
}

/// Topics of one robot that differ from those of `[ros2]`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "StreamsFields", into = "StreamsFields")]
pub struct RobotStreams(StreamsFields);

/// ROS 2 topics of a robot; `[ros2]` in `fleetcal.toml` gives the other ones.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = RobotStreams))]
pub struct StreamsFields {
    /// Prefix of its topics in keys, in place of the templates': `7`, `site/7`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false, examples("7")))]
    pub prefix: Option<TopicName>,
    /// Wheel odometry, measured steering (or yaw rate) and speed in one message, or of joints in
    /// several of one topic.
    #[serde(alias = "drive", skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false))]
    pub wheel_odometry: Option<Source>,
    /// True if its wheel odometry is on the former default topic, `drive`, unless `[ros2]` or
    /// `wheel_odometry` names one: set for robots that were registered while that was the default.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub former_topic: bool,
    /// Steering alone, with `speed` instead of `wheel_odometry`; paired by stamp.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false))]
    pub steering: Option<Source>,
    /// Speed alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false))]
    pub speed: Option<Source>,
    /// `LaserScan`, `PointCloud2` or `MultiEchoLaserScan`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false))]
    pub scan: Option<Source>,
    /// Poses of the LiDAR instead of scans: `Odometry` or `PoseStamped`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false))]
    pub lidar_odometry: Option<Source>,
    /// Joints that steer and drive, for messages of joints.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false))]
    pub joints: Option<Joints>,
    /// Steering angle of the (virtual) centre wheel, rad, left positive, for each unit of the
    /// message beyond `steering_zero`, whatever its type; 1 unless given.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false))]
    pub steering_gear: Option<f64>,
    /// Steering in the message when the vehicle drives straight ahead by its drawing; 0 unless
    /// given.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false))]
    pub steering_zero: Option<f64>,
    /// Speed, m/s, for each unit of the message, whatever its type; 1 unless given.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false))]
    pub speed_gear: Option<f64>,
}

/// Streams that ROS 2 topics carry.
pub const STREAMS_OF_TOPICS: [Stream; 5] = [
    Stream::WheelOdometry,
    Stream::Steering,
    Stream::Speed,
    Stream::Scan,
    Stream::LidarOdometry,
];

/// Topic and the stream that it carries.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TopicRole {
    /// Name below the robot.
    pub topic: TopicName,
    /// Stream of the topic.
    pub stream: Stream,
}

impl RobotStreams {
    /// Configured fields.
    pub fn fields(&self) -> &StreamsFields {
        &self.0
    }

    /// True if nothing is configured.
    pub fn is_default(&self) -> bool {
        self.0 == StreamsFields::default()
    }

    /// Units of steering and speed in the robot's messages.
    pub fn units(&self) -> Units {
        self.0.units()
    }

    /// Configured message type of a stream.
    pub fn message_type(&self, stream: Stream) -> Option<MessageType> {
        self.0.source(stream)?.message_type
    }

    /// Joints of a robot that sends them.
    pub fn joints(&self) -> Option<&Joints> {
        self.0.joints.as_ref()
    }

    /// Keeps a stored robot's former default topic of wheel odometry, unless this configuration or
    /// the stored one names a topic.
    pub fn keep_former_topic(&mut self, stored: &Self) {
        self.0.former_topic |= stored.0.former_topic;
        if self.0.names_wheel_odometry() {
            self.0.former_topic = false;
        }
    }

    /// Default topic of wheel odometry.
    fn usual_topic(&self, settings: &Ros2Settings) -> TopicName {
        match &settings.wheel_odometry {
            Some(topic) => topic.clone(),
            None if self.0.former_topic => TopicName::former_wheel_odometry(),
            None => TopicName::wheel_odometry(),
        }
    }

    /// Topics of the robot: its own, and those of `settings` for the others.
    pub fn roles(&self, settings: &Ros2Settings) -> Vec<TopicRole> {
        let mut roles: Vec<TopicRole> = STREAMS_OF_TOPICS
            .into_iter()
            .filter_map(|stream| {
                let topic = self.0.source(stream)?.topic.clone();
                Some(TopicRole { topic, stream })
            })
            .collect();
        let has = |of: &[Stream]| of.iter().any(|&stream| self.0.source(stream).is_some());
        let mut usual = Vec::new();
        if !self.0.names_wheel_odometry() {
            usual.push((Stream::WheelOdometry, self.usual_topic(settings)));
        }
        if !has(&[Stream::Scan, Stream::LidarOdometry]) {
            usual.push((Stream::Scan, settings.scan.clone()));
            usual.push((Stream::LidarOdometry, settings.lidar_odometry.clone()));
        }
        for (stream, topic) in usual {
            if roles.iter().all(|role| role.topic != topic) {
                roles.push(TopicRole { topic, stream });
            }
        }
        roles
    }
}

impl StreamsFields {
    /// Configured source of a stream, if any.
    pub fn source(&self, stream: Stream) -> Option<&Source> {
        match stream {
            Stream::WheelOdometry => self.wheel_odometry.as_ref(),
            Stream::Steering => self.steering.as_ref(),
            Stream::Speed => self.speed.as_ref(),
            Stream::Scan => self.scan.as_ref(),
            Stream::LidarOdometry => self.lidar_odometry.as_ref(),
            Stream::Event => None,
        }
    }

    /// True if it names a topic of wheel odometry, steering or speed.
    fn names_wheel_odometry(&self) -> bool {
        self.wheel_odometry.is_some() || self.steering.is_some() || self.speed.is_some()
    }

    /// Units of steering and speed in the robot's messages.
    pub fn units(&self) -> Units {
        Units {
            steering_gear: self.steering_gear,
            steering_zero: self.steering_zero,
            speed_gear: self.speed_gear,
        }
    }

    fn check(&self) -> Result<(), String> {
        match (&self.wheel_odometry, &self.steering, &self.speed) {
            (Some(_) | None, None, None) | (None, Some(_), Some(_)) => {}
            (Some(_), ..) => {
                return Err(
                    "streams has wheel_odometry beside steering or speed, expected is \
                     wheel_odometry, or steering and speed"
                        .to_owned(),
                );
            }
            (None, ..) => {
                return Err("streams has one of steering and speed, expected both".to_owned());
            }
        }
        if self.scan.is_some() && self.lidar_odometry.is_some() {
            return Err("streams has scan and lidar_odometry, expected one of them".to_owned());
        }
        let mut topics = BTreeSet::new();
        for stream in STREAMS_OF_TOPICS {
            let Some(source) = self.source(stream) else {
                continue;
            };
            let topic = source.topic.as_str();
            if !topics.insert(topic) {
                return Err(format!(
                    "streams has the topic {topic} twice, expected one stream for each; steering \
                     and speed in one message are wheel_odometry"
                ));
            }
            self.check_type(stream, source.message_type)?;
        }
        self.units().check()?;
        self.joints.as_ref().map_or(Ok(()), Joints::check)
    }

    fn check_type(&self, stream: Stream, of: Option<MessageType>) -> Result<(), String> {
        let Some(message_type) = of else {
            return Ok(());
        };
        let name = stream.name();
        let accepted = MessageType::of_stream(stream);
        if !accepted.contains(&message_type) {
            let accepted: Vec<&str> = accepted.iter().map(|of| of.ros_type()).collect();
            return Err(format!(
                "streams.{name}.type: got {}, expected {}",
                message_type.ros_type(),
                accepted.join(" and ")
            ));
        }
        if !matches!(
            message_type,
            MessageType::JointState | MessageType::DynamicJointState
        ) {
            return Ok(());
        }
        let steers = self.joints.as_ref().is_some_and(|of| of.steering.is_some());
        let drives = self.joints.as_ref().is_some_and(|of| !of.wheels.is_empty());
        if (stream != Stream::Speed && !steers) || (stream != Stream::Steering && !drives) {
            return Err(format!(
                "streams.{name} comes as joints and streams.joints does not say by which \
                 joints, expected steering, and wheels with wheel_radius_m"
            ));
        }
        Ok(())
    }
}

impl TryFrom<StreamsFields> for RobotStreams {
    type Error = String;

    fn try_from(fields: StreamsFields) -> Result<Self, String> {
        fields.check()?;
        Ok(Self(fields))
    }
}

impl From<RobotStreams> for StreamsFields {
    fn from(streams: RobotStreams) -> Self {
        streams.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn streams(text: &str) -> Result<RobotStreams, String> {
        toml::from_str(text).map_err(|error| error.message().to_owned())
    }

    fn roles(text: &str) -> Vec<(String, Stream)> {
        let roles = streams(text).unwrap().roles(&Ros2Settings::default());
        let role = |role: TopicRole| (String::from(role.topic), role.stream);
        roles.into_iter().map(role).collect()
    }

    #[test]
    fn what_is_not_said_is_as_usual() {
        let usual = |topic: &str, stream| (topic.to_owned(), stream);
        assert_eq!(
            roles(""),
            [
                usual("wheel_odometry", Stream::WheelOdometry),
                usual("scan", Stream::Scan),
                usual("lidar_odometry", Stream::LidarOdometry)
            ]
        );
        let text = "steering = { topic = 'joint_states' }\nspeed = { topic = 'odom' }\n\
                    scan = { topic = 'front/scan' }";
        assert_eq!(
            roles(text),
            [
                usual("joint_states", Stream::Steering),
                usual("odom", Stream::Speed),
                usual("front/scan", Stream::Scan)
            ]
        );
    }

    #[test]
    fn former_names_are_read_and_the_former_topic_is_kept_until_one_is_named() {
        let read = streams("drive = { topic = 'drive' }").unwrap();
        let written = serde_json::to_string(&read).unwrap();
        assert_eq!(written, r#"{"wheel_odometry":{"topic":"drive"}}"#);
        let topic = |streams: &RobotStreams, settings: &str| {
            let settings: Ros2Settings = toml::from_str(settings).unwrap();
            let role = streams.roles(&settings).into_iter();
            let mut role = role.filter(|role| role.stream == Stream::WheelOdometry);
            String::from(role.next().unwrap().topic)
        };
        let stored = streams("former_topic = true").unwrap();
        assert_eq!(topic(&stored, ""), "drive");
        assert_eq!(topic(&stored, "drive = 'feedback'"), "feedback");
        assert_eq!(topic(&RobotStreams::default(), ""), "wheel_odometry");

        let mut given = RobotStreams::default();
        given.keep_former_topic(&stored);
        assert_eq!(given, stored);
        let mut named = read.clone();
        named.keep_former_topic(&stored);
        assert_eq!(named, read);
    }

    #[test]
    fn each_refusal_names_its_key() {
        let joints = "steering = { topic = 'j', type = 'sensor_msgs/msg/JointState' }\n\
                      speed = { topic = 'o' }\n";
        for (text, wanted) in [
            (
                "wheel_odometry = { topic = '/odom' }",
                "topic: got \"/odom\"",
            ),
            (
                "wheel_odometry = { topic = 'a/*/b' }",
                "topic: got \"a/*/b\"",
            ),
            ("speed = { topic = 'o' }", "one of steering and speed"),
            (
                "wheel_odometry = { topic = 'd' }\nspeed = { topic = 'o' }",
                "wheel_odometry beside",
            ),
            (
                "scan = { topic = 's' }\nlidar_odometry = { topic = 'o' }",
                "scan and lidar_odometry",
            ),
            (
                "steering = { topic = 'j' }\nspeed = { topic = 'j' }",
                "topic j twice",
            ),
            (
                "scan = { topic = 's', type = 'nav_msgs/msg/Odometry' }",
                "streams.scan.type",
            ),
            (joints, "does not say by which joints"),
            (&format!("{joints}joints = {{}}"), "does not say by which"),
            ("joints = { wheels = ['w'] }", "wheel_radius_m: got nothing"),
            (
                "joints = { steering = 's', steering_gear = 0.0 }",
                "steering_gear: got 0",
            ),
            ("joints = { steering = '' }", "a joint \"\""),
            ("camera = 1", "camera"),
        ] {
            let sentence = streams(text).unwrap_err();
            assert!(sentence.contains(wanted), "{text}: {sentence}");
        }
        let good = format!("{joints}joints = {{ steering = 's' }}");
        let read = streams(&good).unwrap();
        assert_eq!(
            read.message_type(Stream::Steering),
            Some(MessageType::JointState)
        );
        let json = serde_json::to_string(&read).unwrap();
        assert_eq!(serde_json::from_str::<RobotStreams>(&json).unwrap(), read);
    }
}
