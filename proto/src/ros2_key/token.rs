//! Liveliness tokens by which ROS 2 nodes announce their publishers.

use super::{KeyLayout, layout_of_hash, ros_type_name};

/// The tokens of `rmw_zenoh`, without and with a Zenoh namespace before them.
pub const TOKENS_OF_RMW: [&str; 2] = ["@ros2_lv/**", "*/@ros2_lv/**"];
/// The tokens of `zenoh-bridge-ros2dds`.
pub const TOKENS_OF_BRIDGE: &str = "@/*/@ros2_lv/**";

const MARK: &str = "@ros2_lv";
/// A publisher of messages.
const PUBLISHER: &str = "MP";
/// What stands for a slash in a token of `rmw_zenoh`, and in one of the bridge.
const SLASH_OF_RMW: char = '%';
const SLASH_OF_BRIDGE: char = '\u{a7}';

/// A publisher that a token announces.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Announcement {
    /// The topic's path, as in the keys of its messages: `0/tugger_01/scan`.
    pub path: String,
    /// Its type, `sensor_msgs/msg/LaserScan`.
    pub type_name: String,
    /// Which keys its messages have.
    pub layout: KeyLayout,
}

impl Announcement {
    /// Reads a token's key; `None` of one that announces no publisher of messages.
    pub fn of_token(key: &str) -> Option<Self> {
        let chunks: Vec<&str> = key.split('/').collect();
        if let ["@", _, MARK, PUBLISHER, path, type_name, ..] = *chunks.as_slice() {
            return Some(Self {
                path: path.replace(SLASH_OF_BRIDGE, "/"),
                type_name: ros_type_name(type_name),
                layout: KeyLayout::BridgeRos2dds,
            });
        }
        let mark = chunks.iter().position(|&chunk| chunk == MARK)?;
        let (namespace, behind) = chunks.split_at(mark);
        let [
            _,
            domain,
            _session,
            _node_id,
            _id,
            PUBLISHER,
            _enclave,
            _ros_namespace,
            _node,
            topic,
            type_name,
            hash,
            ..,
        ] = *behind
        else {
            return None;
        };
        let topic = topic.replace(SLASH_OF_RMW, "/");
        let mut path: Vec<&str> = namespace.to_vec();
        path.extend([domain, topic.trim_matches('/')]);
        Some(Self {
            path: path.join("/"),
            type_name: ros_type_name(type_name),
            layout: layout_of_hash(hash),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn publishers_of_every_layout_are_read() {
        let read = |key: &str| Announcement::of_token(key).unwrap();
        let node = "0/3f2a/0/11/MP/%/%tugger_01/lidar_driver";
        let scan = "%tugger_01%front%scan/sensor_msgs::msg::dds_::LaserScan_";
        let jazzy = read(&format!("@ros2_lv/{node}/{scan}/RIHS01_64c1/::,10:,:,:,,"));
        assert_eq!(jazzy.path, "0/tugger_01/front/scan");
        assert_eq!(jazzy.type_name, "sensor_msgs/msg/LaserScan");
        assert_eq!(jazzy.layout, KeyLayout::RmwZenoh);
        let humble = read(&format!(
            "@ros2_lv/{node}/{scan}/TypeHashNotSupported/::,10:,:,:,,"
        ));
        assert_eq!(humble.layout, KeyLayout::RmwZenohWithoutHash);
        let spaced = read(&format!("robotA/@ros2_lv/{node}/{scan}/RIHS01_64c1/x"));
        assert_eq!(spaced.path, "robotA/0/tugger_01/front/scan");
        let bridge = read(
            "@/3f2a/@ros2_lv/MP/tugger_01\u{a7}scan/sensor_msgs\u{a7}msg\u{a7}LaserScan/:::,10",
        );
        assert_eq!(bridge.path, "tugger_01/scan");
        assert_eq!(bridge.type_name, "sensor_msgs/msg/LaserScan");
        assert_eq!(bridge.layout, KeyLayout::BridgeRos2dds);
    }

    #[test]
    fn what_announces_no_publisher_is_none() {
        for key in [
            "@ros2_lv/0/3f2a/0/0/NN/%/%/node",
            "@ros2_lv/0/3f2a/0/12/MS/%/%/node/%scan/sensor_msgs::msg::dds_::LaserScan_/h/q",
            "@/3f2a/@ros2_lv",
            "@/3f2a/@ros2_lv/MS/scan/sensor_msgs\u{a7}msg\u{a7}LaserScan/:::,10",
            "fleet/@alive/tugger_01",
            "",
        ] {
            assert_eq!(Announcement::of_token(key), None, "{key}");
        }
    }
}
