//! Definitions of the ROS 2 messages that are written, as MCAP's `ros2msg` schemas have them:
//! the message's own fields, then every type it is made of behind a line of 80 `=`.

use fleetcal_proto::message_type::MessageType;

/// Concatenates one definition: its own file, then those of the types it is made of. A header and
/// its time are in all of them.
macro_rules! definition {
    (@ $name:literal $(, $package:literal $part:literal)*) => {
        concat!(
            include_str!(concat!("definitions/", $name, ".msg")),
            $(
                "================================================================================\n",
                "MSG: ", $package, "/", $part, "\n",
                include_str!(concat!("definitions/", $part, ".msg")),
            )*
        )
    };
    ($name:literal $(, $package:literal $part:literal)*) => {
        definition!(
            @ $name $(, $package $part)*, "std_msgs" "Header", "builtin_interfaces" "Time"
        )
    };
}

/// Definition of `tf2_msgs/msg/TFMessage`.
pub(super) const TF_MESSAGE: &str = definition!(
    "TFMessage",
    "geometry_msgs" "TransformStamped",
    "geometry_msgs" "Transform",
    "geometry_msgs" "Vector3",
    "geometry_msgs" "Quaternion"
);

/// Definition of `rcl_interfaces/msg/Log`.
pub(super) const LOG: &str = definition!(@ "Log", "builtin_interfaces" "Time");

/// Definition of `fleetcal_msgs/msg/Estimate`.
pub(super) const ESTIMATE: &str = definition!("Estimate", "fleetcal_msgs" "ParameterEstimate");

/// Returns the definition of a type.
pub(super) const fn of(message_type: MessageType) -> &'static str {
    match message_type {
        MessageType::AckermannDriveStamped => definition!(
            "AckermannDriveStamped",
            "ackermann_msgs" "AckermannDrive"
        ),
        MessageType::DriveSamples => definition!(
            @ "DriveSamples", "fleetcal_msgs" "DriveSample", "builtin_interfaces" "Time"
        ),
        MessageType::JointState => definition!("JointState"),
        MessageType::LaserScan => definition!("LaserScan"),
        MessageType::MultiEchoLaserScan => {
            definition!("MultiEchoLaserScan", "sensor_msgs" "LaserEcho")
        }
        MessageType::AckermannDrive => definition!(@ "AckermannDrive"),
        MessageType::Float32 => definition!(@ "Float32"),
        MessageType::Float64 => definition!(@ "Float64"),
        MessageType::SteeringReport => {
            definition!(@ "SteeringReport", "builtin_interfaces" "Time")
        }
        MessageType::VelocityReport => definition!("VelocityReport"),
        MessageType::SteeringControllerStatus => definition!("SteeringControllerStatus"),
        MessageType::DynamicJointState => {
            definition!("DynamicJointState", "control_msgs" "InterfaceValue")
        }
        MessageType::VescStateStamped => {
            definition!("VescStateStamped", "vesc_msgs" "VescState")
        }
        MessageType::TwistWithCovarianceStamped => definition!(
            "TwistWithCovarianceStamped",
            "geometry_msgs" "TwistWithCovariance",
            "geometry_msgs" "Twist",
            "geometry_msgs" "Vector3"
        ),
        MessageType::PointCloud2 => definition!("PointCloud2", "sensor_msgs" "PointField"),
        MessageType::PoseStamped => definition!(
            "PoseStamped",
            "geometry_msgs" "Pose",
            "geometry_msgs" "Point",
            "geometry_msgs" "Quaternion"
        ),
        MessageType::TwistStamped => definition!(
            "TwistStamped",
            "geometry_msgs" "Twist",
            "geometry_msgs" "Vector3"
        ),
        MessageType::Odometry => definition!(
            "Odometry",
            "geometry_msgs" "PoseWithCovariance",
            "geometry_msgs" "Pose",
            "geometry_msgs" "Point",
            "geometry_msgs" "Quaternion",
            "geometry_msgs" "TwistWithCovariance",
            "geometry_msgs" "Twist",
            "geometry_msgs" "Vector3"
        ),
    }
}
