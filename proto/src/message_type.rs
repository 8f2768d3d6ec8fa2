//! Type of a payload's ROS 2 message, and its spellings.

use std::borrow::Cow;

use fleetcal_model::Stream;
use serde::{Deserialize, Serialize};

use crate::encoding::{DecodeError, Encoding};
use crate::ros::{
    AckermannDrive, AckermannDriveStamped, DriveSamples, DynamicJointState, Float32, Float64,
    JointState, Joints, LaserScan, MultiEchoLaserScan, Odometry, PointCloud2, PoseStamped,
    RosMessage, SteeringControllerStatus, SteeringReport, TwistStamped, TwistWithCovarianceStamped,
    VelocityReport, VescStateStamped, WheelMessage, Wheels,
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
    /// Speed and steering in one, without a stamp.
    #[serde(rename = "ackermann_msgs/msg/AckermannDrive")]
    AckermannDrive,
    /// Steering and wheels as joints with all their interfaces.
    #[serde(rename = "control_msgs/msg/DynamicJointState")]
    DynamicJointState,
    /// Steering and wheels of a controller.
    #[serde(rename = "control_msgs/msg/SteeringControllerStatus")]
    SteeringControllerStatus,
    /// Velocities and their covariance.
    #[serde(rename = "geometry_msgs/msg/TwistWithCovarianceStamped")]
    TwistWithCovarianceStamped,
    /// Steering under Autoware.
    #[serde(
        rename = "autoware_vehicle_msgs/msg/SteeringReport",
        alias = "autoware_auto_vehicle_msgs/msg/SteeringReport"
    )]
    SteeringReport,
    /// Velocities under Autoware.
    #[serde(
        rename = "autoware_vehicle_msgs/msg/VelocityReport",
        alias = "autoware_auto_vehicle_msgs/msg/VelocityReport"
    )]
    VelocityReport,
    /// A motor's state.
    #[serde(rename = "vesc_msgs/msg/VescStateStamped")]
    VescStateStamped,
    /// A number without a stamp.
    #[serde(rename = "std_msgs/msg/Float32")]
    Float32,
    /// A longer number without a stamp.
    #[serde(rename = "std_msgs/msg/Float64")]
    Float64,
    /// A planar scan.
    #[serde(rename = "sensor_msgs/msg/LaserScan")]
    LaserScan,
    /// A planar scan with several echoes.
    #[serde(rename = "sensor_msgs/msg/MultiEchoLaserScan")]
    MultiEchoLaserScan,
    /// The cloud of a 3D scanner.
    #[serde(rename = "sensor_msgs/msg/PointCloud2")]
    PointCloud2,
}

/// Evaluates an expression with the struct of a message type under a name.
macro_rules! of_each {
    ($message_type:expr, $message:ident => $value:expr) => {
        of_each!($message_type, $message => $value;
            AckermannDriveStamped DriveSamples JointState Odometry TwistStamped PoseStamped
            LaserScan PointCloud2 AckermannDrive DynamicJointState SteeringControllerStatus
            TwistWithCovarianceStamped SteeringReport VelocityReport VescStateStamped Float32
            Float64 MultiEchoLaserScan)
    };
    ($message_type:expr, $message:ident => $value:expr; $($name:ident)*) => {
        match $message_type {
            $(Self::$name => {
                type $message = $name;
                $value
            })*
        }
    };
}

impl MessageType {
    /// All message types.
    pub const ALL: [Self; 18] = [
        Self::AckermannDriveStamped,
        Self::DriveSamples,
        Self::JointState,
        Self::Odometry,
        Self::TwistStamped,
        Self::PoseStamped,
        Self::LaserScan,
        Self::PointCloud2,
        Self::AckermannDrive,
        Self::DynamicJointState,
        Self::SteeringControllerStatus,
        Self::TwistWithCovarianceStamped,
        Self::SteeringReport,
        Self::VelocityReport,
        Self::VescStateStamped,
        Self::Float32,
        Self::Float64,
        Self::MultiEchoLaserScan,
    ];

    /// Message types with steering (or a yaw rate) and speed in one, the usual one first.
    pub const OF_WHEEL_ODOMETRY: &'static [Self] = &[
        Self::AckermannDriveStamped,
        Self::JointState,
        Self::DriveSamples,
        Self::AckermannDrive,
        Self::DynamicJointState,
        Self::SteeringControllerStatus,
        Self::Odometry,
        Self::TwistStamped,
        Self::TwistWithCovarianceStamped,
        Self::VelocityReport,
    ];
    /// Message types with a steering angle.
    pub const OF_STEERING: &'static [Self] = &[
        Self::JointState,
        Self::AckermannDriveStamped,
        Self::AckermannDrive,
        Self::DynamicJointState,
        Self::SteeringControllerStatus,
        Self::SteeringReport,
        Self::Float32,
        Self::Float64,
    ];
    /// Message types with a speed.
    pub const OF_SPEED: &'static [Self] = &[
        Self::Odometry,
        Self::TwistStamped,
        Self::JointState,
        Self::AckermannDriveStamped,
        Self::AckermannDrive,
        Self::DynamicJointState,
        Self::SteeringControllerStatus,
        Self::TwistWithCovarianceStamped,
        Self::VelocityReport,
        Self::VescStateStamped,
        Self::Float32,
        Self::Float64,
    ];
    /// Message types of scans.
    pub const OF_SCAN: &'static [Self] =
        &[Self::LaserScan, Self::PointCloud2, Self::MultiEchoLaserScan];
    /// Message types with a pose of the LiDAR.
    pub const OF_LIDAR_ODOMETRY: &'static [Self] = &[Self::Odometry, Self::PoseStamped];

    /// Returns its ROS 2 type, `sensor_msgs/msg/LaserScan`.
    pub const fn ros_type(self) -> &'static str {
        of_each!(self, Message => Message::TYPE)
    }

    /// Returns the steering and speed that a payload states; `None` for types without either, or
    /// with several of them.
    ///
    /// # Errors
    /// Names the field that is missing or has an impossible value.
    pub fn wheels(
        self,
        encoding: Encoding,
        payload: &[u8],
        joints: Option<&Joints>,
    ) -> Result<Option<Wheels>, DecodeError> {
        fn of<M: WheelMessage>(
            (encoding, payload): (Encoding, &[u8]),
            joints: Option<&Joints>,
        ) -> Result<Option<Wheels>, DecodeError> {
            Ok(Some(M::decode(encoding, payload)?.wheels(joints)))
        }
        let sent = (encoding, payload);
        match self {
            Self::AckermannDriveStamped => of::<AckermannDriveStamped>(sent, joints),
            Self::AckermannDrive => of::<AckermannDrive>(sent, joints),
            Self::JointState => of::<JointState>(sent, joints),
            Self::DynamicJointState => of::<DynamicJointState>(sent, joints),
            Self::SteeringControllerStatus => of::<SteeringControllerStatus>(sent, joints),
            Self::Odometry => of::<Odometry>(sent, joints),
            Self::TwistStamped => of::<TwistStamped>(sent, joints),
            Self::TwistWithCovarianceStamped => of::<TwistWithCovarianceStamped>(sent, joints),
            Self::SteeringReport => of::<SteeringReport>(sent, joints),
            Self::VelocityReport => of::<VelocityReport>(sent, joints),
            Self::VescStateStamped => of::<VescStateStamped>(sent, joints),
            Self::Float32 => of::<Float32>(sent, joints),
            Self::Float64 => of::<Float64>(sent, joints),
            Self::DriveSamples
            | Self::PoseStamped
            | Self::LaserScan
            | Self::MultiEchoLaserScan
            | Self::PointCloud2 => Ok(None),
        }
    }

    /// Returns the types that a stream may have, the usual one first; empty for a stream without a
    /// ROS topic.
    pub const fn of_stream(stream: Stream) -> &'static [Self] {
        match stream {
            Stream::WheelOdometry => Self::OF_WHEEL_ODOMETRY,
            Stream::Steering => Self::OF_STEERING,
            Stream::Speed => Self::OF_SPEED,
            Stream::Scan => Self::OF_SCAN,
            Stream::LidarOdometry => Self::OF_LIDAR_ODOMETRY,
            Stream::Event => &[],
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
        let cdr = of_each!(self, Message => Message::from_json(payload)?.to_cdr());
        Ok(Cow::Owned(cdr))
    }

    /// Returns its name in the keys of `rmw_zenoh`, `sensor_msgs::msg::dds_::LaserScan_`.
    pub fn dds_type(self) -> String {
        let (package, name) = self.package_and_name();
        format!("{package}::msg::dds_::{name}_")
    }

    /// Returns its names in the keys of `rmw_zenoh`, that of its former package included.
    pub fn dds_types(self) -> impl Iterator<Item = String> {
        let (package, name) = self.package_and_name();
        let packages = [Some(package), self.former_package()];
        let packages = packages.into_iter().flatten();
        packages.map(move |package| format!("{package}::msg::dds_::{name}_"))
    }

    /// Package in which the type was before, with the same fields.
    const fn former_package(self) -> Option<&'static str> {
        match self {
            Self::SteeringReport | Self::VelocityReport => Some("autoware_auto_vehicle_msgs"),
            _ => None,
        }
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
            let is_own = |package| package == own_package || Some(package) == of.former_package();
            own_name == last && package.is_none_or(is_own)
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
    fn the_former_package_of_a_type_is_read_too() {
        for (message_type, name) in [
            (MessageType::SteeringReport, "SteeringReport"),
            (MessageType::VelocityReport, "VelocityReport"),
        ] {
            let ros_type = format!("autoware_auto_vehicle_msgs/msg/{name}");
            let dds_type = format!("autoware_auto_vehicle_msgs::msg::dds_::{name}_");
            for spelling in [&ros_type, &dds_type, &ros_type.replace('/', "\u{a7}")] {
                assert_eq!(MessageType::of_ros_type(spelling), Some(message_type));
            }
            let json = format!("{ros_type:?}");
            assert_eq!(
                serde_json::from_str::<MessageType>(&json).unwrap(),
                message_type
            );
            let names: Vec<String> = message_type.dds_types().collect();
            assert_eq!(names, [message_type.dds_type(), dds_type]);
        }
        let names = MessageType::LaserScan.dds_types();
        assert_eq!(
            names.collect::<Vec<_>>(),
            [MessageType::LaserScan.dds_type()]
        );
        let other = "autoware_auto_vehicle_msgs/msg/LaserScan";
        assert_eq!(MessageType::of_ros_type(other), None);
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
