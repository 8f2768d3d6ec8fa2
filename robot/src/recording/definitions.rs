//! Definitions of the ROS 2 messages that are written, as MCAP's `ros2msg` schemas have them:
//! the message's own fields, then every type it is made of behind a line of 80 `=`.

pub(super) const ACKERMANN: &str = concat!(
    include_str!("definitions/AckermannDriveStamped.msg"),
    "================================================================================\n",
    "MSG: ackermann_msgs/AckermannDrive\n",
    include_str!("definitions/AckermannDrive.msg"),
    "================================================================================\n",
    "MSG: std_msgs/Header\n",
    include_str!("definitions/Header.msg"),
    "================================================================================\n",
    "MSG: builtin_interfaces/Time\n",
    include_str!("definitions/Time.msg"),
);

pub(super) const LASER_SCAN: &str = concat!(
    include_str!("definitions/LaserScan.msg"),
    "================================================================================\n",
    "MSG: std_msgs/Header\n",
    include_str!("definitions/Header.msg"),
    "================================================================================\n",
    "MSG: builtin_interfaces/Time\n",
    include_str!("definitions/Time.msg"),
);

pub(super) const POSE_STAMPED: &str = concat!(
    include_str!("definitions/PoseStamped.msg"),
    "================================================================================\n",
    "MSG: geometry_msgs/Pose\n",
    include_str!("definitions/Pose.msg"),
    "================================================================================\n",
    "MSG: geometry_msgs/Point\n",
    include_str!("definitions/Point.msg"),
    "================================================================================\n",
    "MSG: geometry_msgs/Quaternion\n",
    include_str!("definitions/Quaternion.msg"),
    "================================================================================\n",
    "MSG: std_msgs/Header\n",
    include_str!("definitions/Header.msg"),
    "================================================================================\n",
    "MSG: builtin_interfaces/Time\n",
    include_str!("definitions/Time.msg"),
);

pub(super) const POINT_CLOUD: &str = concat!(
    include_str!("definitions/PointCloud2.msg"),
    "================================================================================\n",
    "MSG: sensor_msgs/PointField\n",
    include_str!("definitions/PointField.msg"),
    "================================================================================\n",
    "MSG: std_msgs/Header\n",
    include_str!("definitions/Header.msg"),
    "================================================================================\n",
    "MSG: builtin_interfaces/Time\n",
    include_str!("definitions/Time.msg"),
);

pub(super) const ODOMETRY: &str = concat!(
    include_str!("definitions/Odometry.msg"),
    "================================================================================\n",
    "MSG: geometry_msgs/PoseWithCovariance\n",
    include_str!("definitions/PoseWithCovariance.msg"),
    "================================================================================\n",
    "MSG: geometry_msgs/Pose\n",
    include_str!("definitions/Pose.msg"),
    "================================================================================\n",
    "MSG: geometry_msgs/Point\n",
    include_str!("definitions/Point.msg"),
    "================================================================================\n",
    "MSG: geometry_msgs/Quaternion\n",
    include_str!("definitions/Quaternion.msg"),
    "================================================================================\n",
    "MSG: geometry_msgs/TwistWithCovariance\n",
    include_str!("definitions/TwistWithCovariance.msg"),
    "================================================================================\n",
    "MSG: geometry_msgs/Twist\n",
    include_str!("definitions/Twist.msg"),
    "================================================================================\n",
    "MSG: geometry_msgs/Vector3\n",
    include_str!("definitions/Vector3.msg"),
    "================================================================================\n",
    "MSG: std_msgs/Header\n",
    include_str!("definitions/Header.msg"),
    "================================================================================\n",
    "MSG: builtin_interfaces/Time\n",
    include_str!("definitions/Time.msg"),
);
