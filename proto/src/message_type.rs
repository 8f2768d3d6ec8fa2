//! Type of a payload's ROS 2 message, and its spellings.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use crate::encoding::{DecodeError, Encoding};
use crate::ros::{
    AckermannDriveStamped, DriveSamples, JointState, LaserScan, Odometry, PointCloud2, PoseStamped,
    RosMessage, TwistStamped,
};

/// ROS 2 message types of a robot's streams.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum MessageType {
    /// Speed and steering in one.
    #[serde(rename = "ackermann_msgs/msg/AckermannDriveStamped")]
    AckermannDriveStamped,
    /// Several measurements of speed and steering.
    #[serde(rename = "fleetcal_msgs/msg/DriveSamples")]
    DriveSamples,
    /// Steering and wheels as joints.
    #[serde(rename = "sensor_msgs/msg/JointState")]
    JointState,
    /// A pose with its velocities.
    #[serde(rename = "nav_msgs/msg/Odometry")]
    Odometry,
    /// Velocities.
    #[serde(rename = "geometry_msgs/msg/TwistStamped")]
    TwistStamped,
    /// A pose.
    #[serde(rename = "geometry_msgs/msg/PoseStamped")]
    PoseStamped,
    /// A planar scan.
    #[serde(rename = "sensor_msgs/msg/LaserScan")]
    LaserScan,
    /// The cloud of a 3D scanner.
    #[serde(rename = "sensor_msgs/msg/PointCloud2")]
    PointCloud2,
}

impl MessageType {
    /// All message types.
    pub const ALL: [Self; 8] = [
        Self::AckermannDriveStamped,
        Self::DriveSamples,
        Self::JointState,
        Self::Odometry,
        Self::TwistStamped,
        Self::PoseStamped,
        Self::LaserScan,
        Self::PointCloud2,
    ];

    /// Message types with steering and speed in one, the usual one first.
    pub const OF_WHEEL_ODOMETRY: &'static [Self] = &[
        Self::AckermannDriveStamped,
        Self::JointState,
        Self::DriveSamples,
    ];
    /// Message types with a steering angle.
    pub const OF_STEERING: &'static [Self] = &[Self::JointState, Self::AckermannDriveStamped];
    /// Message types with a speed.
    pub const OF_SPEED: &'static [Self] = &[
        Self::Odometry,
        Self::TwistStamped,
        Self::JointState,
        Self::AckermannDriveStamped,
    ];
    /// Message types of scans.
    pub const OF_SCAN: &'static [Self] = &[Self::LaserScan, Self::PointCloud2];
    /// Message types with a pose of the LiDAR.
    pub const OF_LIDAR_ODOMETRY: &'static [Self] = &[Self::Odometry, Self::PoseStamped];

    /// Returns its ROS 2 type, `sensor_msgs/msg/LaserScan`.
    pub const fn ros_type(self) -> &'static str {
        match self {
            Self::AckermannDriveStamped => AckermannDriveStamped::TYPE,
            Self::DriveSamples => DriveSamples::TYPE,
            Self::JointState => JointState::TYPE,
            Self::Odometry => Odometry::TYPE,
            Self::TwistStamped => TwistStamped::TYPE,
            Self::PoseStamped => PoseStamped::TYPE,
            Self::LaserScan => LaserScan::TYPE,
            Self::PointCloud2 => PointCloud2::TYPE,
        }
    }

    /// Returns a payload in CDR: unchanged if it is, converted from JSON otherwise.
    ///
    /// # Errors
    /// The JSON is not such a message.
    pub fn to_cdr(self, encoding: Encoding, payload: &[u8]) -> Result<Cow<'_, [u8]>, DecodeError> {
        if encoding == Encoding::Cdr {
            return Ok(Cow::Borrowed(payload));
        }
        let cdr = match self {
            Self::AckermannDriveStamped => AckermannDriveStamped::from_json(payload)?.to_cdr(),
            Self::DriveSamples => DriveSamples::from_json(payload)?.to_cdr(),
            Self::JointState => JointState::from_json(payload)?.to_cdr(),
            Self::Odometry => Odometry::from_json(payload)?.to_cdr(),
            Self::TwistStamped => TwistStamped::from_json(payload)?.to_cdr(),
            Self::PoseStamped => PoseStamped::from_json(payload)?.to_cdr(),
            Self::LaserScan => LaserScan::from_json(payload)?.to_cdr(),
            Self::PointCloud2 => PointCloud2::from_json(payload)?.to_cdr(),
        };
        Ok(Cow::Owned(cdr))
    }

    /// Returns its name in the keys of `rmw_zenoh`, `sensor_msgs::msg::dds_::LaserScan_`.
    pub fn dds_type(self) -> String {
        let (package, name) = self.package_and_name();
        format!("{package}::msg::dds_::{name}_")
    }

    /// Parses the name of a ROS 2 type in any of the spellings in use, or without its package;
    /// `None` for any other, such as one of the same name in another package.
    pub fn of_ros_type(name: &str) -> Option<Self> {
        let mut parts = name.rsplit(['/', ':', '\u{a7}']);
        let last = parts.next()?;
        let last = last.strip_suffix('_').unwrap_or(last);
        let package = parts.rfind(|part| !part.is_empty());
        let is_it = |of: &Self| {
            let (own_package, own_name) = of.package_and_name();
            own_name == last && package.is_none_or(|package| package == own_package)
        };
        Self::ALL.into_iter().find(is_it)
    }

    fn package_and_name(self) -> (&'static str, &'static str) {
        self.ros_type().split_once("/msg/").unwrap_or_default()
    }
}

/// Configured message type of a robot's scans.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum ScanType {
    /// `sensor_msgs/msg/LaserScan`.
    #[default]
    #[serde(rename = "laser_scan")]
    LaserScan,
    /// `sensor_msgs/msg/PointCloud2`.
    #[serde(rename = "point_cloud2")]
    PointCloud2,
}

impl ScanType {
    /// Returns the message type.
    pub const fn message_type(self) -> MessageType {
        match self {
            Self::LaserScan => MessageType::LaserScan,
            Self::PointCloud2 => MessageType::PointCloud2,
        }
    }
}

/// Form of a payload: its encoding, and its type where the sender names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Form {
    /// CDR or JSON.
    pub encoding: Encoding,
    /// Type behind the `;` of a Zenoh encoding or in the key, if it is one of [`MessageType`].
    pub message_type: Option<MessageType>,
}

impl Form {
    /// Parses a Zenoh encoding.
    ///
    /// # Errors
    /// Any other encoding than CDR and JSON, by name.
    pub fn parse(text: &str) -> Result<Self, DecodeError> {
        let schema = text.split_once(';').map(|(_, schema)| schema.trim());
        Ok(Self {
            encoding: Encoding::parse(text)?,
            message_type: schema.and_then(MessageType::of_ros_type),
        })
    }

    /// Returns its name on the wire: `application/cdr;sensor_msgs/msg/PointCloud2`.
    pub fn to_text(self) -> String {
        let encoding = self.encoding.as_str();
        match self.message_type {
            None => encoding.to_owned(),
            Some(message_type) => format!("{encoding};{}", message_type.ros_type()),
        }
    }
}

impl From<Encoding> for Form {
    fn from(encoding: Encoding) -> Self {
        Self {
            encoding,
            message_type: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_schema_names_the_type() {
        let form = |text: &str| Form::parse(text).unwrap();
        for name in [
            "sensor_msgs/msg/PointCloud2",
            "sensor_msgs::msg::dds_::PointCloud2_",
            "PointCloud2",
        ] {
            let text = format!("application/cdr;{name}");
            assert_eq!(form(&text).message_type, Some(MessageType::PointCloud2));
        }
        let scan = form("application/json;sensor_msgs/msg/LaserScan");
        assert_eq!(scan.encoding, Encoding::Json);
        assert_eq!(scan.message_type, Some(MessageType::LaserScan));
        for text in [
            "",
            "application/cdr",
            "application/cdr;Image",
            "text/json;x/1",
        ] {
            assert_eq!(form(text).message_type, None, "{text}");
        }
        assert!(Form::parse("image/png;PointCloud2").is_err());
        for text in [
            "application/cdr;sensor_msgs/msg/PointCloud2",
            "application/json",
        ] {
            assert_eq!(form(text).to_text(), text);
        }
    }

    #[test]
    fn every_type_is_read_in_every_spelling() {
        for message_type in MessageType::ALL {
            let ros_type = message_type.ros_type();
            for name in [
                ros_type.to_owned(),
                message_type.dds_type(),
                ros_type.replace('/', "\u{a7}"),
                ros_type.replace("/msg/", "/"),
            ] {
                assert_eq!(MessageType::of_ros_type(&name), Some(message_type));
            }
            let json = serde_json::to_string(&message_type).unwrap();
            assert_eq!(json, format!("{ros_type:?}"));
        }
        for name in [
            "",
            "_",
            "Scan",
            "sensor_msgs/msg/Image",
            "msg/",
            "foxglove_msgs/msg/LaserScan",
            "foxglove_msgs::msg::dds_::LaserScan_",
            "foxglove_msgs\u{a7}msg\u{a7}LaserScan",
            "foxglove.LaserScan",
            "my_msgs/PoseStamped",
        ] {
            assert_eq!(MessageType::of_ros_type(name), None, "{name}");
        }
    }

    #[test]
    fn encodings_are_read_by_name() {
        for text in [
            "",
            "zenoh/bytes",
            "application/cdr",
            "application/cdr;LaserScan",
        ] {
            assert_eq!(Encoding::parse(text).unwrap(), Encoding::Cdr);
        }
        for text in ["application/json", "application/json;x/1", "text/json"] {
            assert_eq!(Encoding::parse(text).unwrap(), Encoding::Json);
        }
        let sentence = Encoding::parse("image/png").unwrap_err().to_string();
        assert!(sentence.contains("image/png") && sentence.contains("application/json"));
        let long = Encoding::parse(&"ü".repeat(1_000_000))
            .unwrap_err()
            .to_string();
        assert!(long.len() < 1000, "a refusal repeats {} bytes", long.len());
    }
}
