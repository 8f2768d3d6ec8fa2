//! Default keys of ROS 2 robots' topics.

use fleetcal_proto::ros2_key::KeyTemplate;
use serde::{Deserialize, Serialize};

use super::NAME_BYTES_MAX;

/// Keys of robots' topics in Zenoh: `[ros2]` of `fleetcal.toml`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ros2Settings {
    /// Templates of the keys of `rmw_zenoh`, without type and hash; an empty list switches them
    /// off.
    pub rmw_zenoh: Vec<KeyTemplate>,
    /// Templates of the keys of `zenoh-bridge-ros2dds`; an empty list switches them off.
    pub bridge: Vec<KeyTemplate>,
    /// Topic of wheel odometry, measured steering and speed, unless a robot's own `streams` say
    /// otherwise; `wheel_odometry` unless given.
    #[serde(alias = "drive", skip_serializing_if = "Option::is_none")]
    pub wheel_odometry: Option<TopicName>,
    /// Topic of the scans.
    pub scan: TopicName,
    /// Topic of the LiDAR's poses.
    pub lidar_odometry: TopicName,
    /// Additional topics that robots registered later may use over the bridge: the access list is
    /// built when the service starts, and the bridge's keys do not state their type.
    pub bridge_topics: Vec<TopicName>,
    /// True if the approved calibration is also published as a ROS 2 topic.
    pub publish_calibration: bool,
}

impl Default for Ros2Settings {
    fn default() -> Self {
        let template = |text| KeyTemplate::parse(text).into_iter().collect();
        Self {
            rmw_zenoh: template("{domain}/{robot}/{topic}"),
            bridge: template("{robot}/{topic}"),
            wheel_odometry: None,
            scan: TopicName("scan".to_owned()),
            lidar_odometry: TopicName("lidar_odometry".to_owned()),
            bridge_topics: Vec::new(),
            publish_calibration: true,
        }
    }
}

/// Name of a topic below its robot, such as `front/scan`: chunks parted by one slash, and no slash
/// at the ends.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(value_type = String))]
pub struct TopicName(String);

impl TopicName {
    /// Default topic of wheel odometry.
    pub(super) fn wheel_odometry() -> Self {
        Self("wheel_odometry".to_owned())
    }

    /// Former default topic of wheel odometry: by convention the topic of the command on Ackermann
    /// robots.
    pub(super) fn former_wheel_odometry() -> Self {
        Self("drive".to_owned())
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl TryFrom<String> for TopicName {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let good = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-');
        let chunk = |chunk: &str| !chunk.is_empty() && chunk.chars().all(good);
        if text.len() <= NAME_BYTES_MAX && text.split('/').all(chunk) {
            return Ok(Self(text));
        }
        Err(format!(
            "topic: got {text:?}, expected its name below the robot, without a slash at the ends: \
             front/scan"
        ))
    }
}

impl From<TopicName> for String {
    fn from(name: TopicName) -> Self {
        name.0
    }
}
