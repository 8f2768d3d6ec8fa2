//! Liveliness tokens by which ROS 2 nodes announce themselves and their publishers.

use super::{KeyLayout, layout_of_hash, ros_type_name};

/// Tokens of `rmw_zenoh`, without and with a Zenoh namespace before them.
pub const TOKENS_OF_RMW: [&str; 2] = ["@ros2_lv/**", "*/@ros2_lv/**"];
/// Tokens of `zenoh-bridge-ros2dds`.
pub const TOKENS_OF_BRIDGE: &str = "@/*/@ros2_lv/**";

const MARK: &str = "@ros2_lv";
/// Kind of a node in a token.
const NODE: &str = "NN";
/// Kind of a publisher of messages in a token.
const PUBLISHER: &str = "MP";
/// Placeholder of an empty name in a token of `rmw_zenoh`.
const EMPTY: &str = "%";
/// Settings that differ from the defaults of `rmw_zenoh`: reliable, transient-local, the last
/// message alone.
const LATCHED: &str = ":1:,1:,:,:,,";
/// Placeholder of a slash in a token of `rmw_zenoh`.
const SLASH_OF_RMW: char = '%';
/// Placeholder of a slash in a token of the bridge.
const SLASH_OF_BRIDGE: char = '\u{a7}';

/// Publisher that a token announces.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Announcement {
    /// The topic's path, as in the keys of its messages: `0/tugger_01/scan`.
    pub path: String,
    /// Its type, `sensor_msgs/msg/LaserScan`.
    pub type_name: String,
    /// Layout of its messages' keys.
    pub layout: KeyLayout,
}

impl Announcement {
    /// Parses a token's key; `None` if it does not announce a publisher of messages.
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

/// A node with one publisher of the last message, reliable and transient-local, in the form that
/// `rmw_zenoh` announces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LatchedTopic<'a> {
    /// Prefix of the topic in keys, including the ROS domain: `0/tugger_01`. It is the node's
    /// namespace too.
    pub prefix: &'a str,
    /// The topic's name below that: `calibration/approved`.
    pub topic: &'a str,
    /// Its type as in keys, `std_msgs::msg::dds_::String_`.
    pub dds_type: &'a str,
    /// The type's hash as in keys, or [`super::NO_HASH`].
    pub hash: &'a str,
    /// The node's name.
    pub node: &'a str,
    /// The Zenoh id of the session.
    pub session: &'a str,
    /// The node's number in the session; the next one is the publisher's.
    pub number: u64,
}

impl LatchedTopic<'_> {
    /// Returns the keys of its tokens, the node's and the publisher's; `None` if no chunk of the
    /// prefix is a domain. Names of ROS 2 never begin with a digit, so the last number is the
    /// domain, and the part before it a Zenoh namespace.
    pub fn tokens(&self) -> Option<[String; 2]> {
        let chunks: Vec<&str> = self.prefix.split('/').collect();
        let is_number = |chunk: &&str| chunk.bytes().all(|byte| byte.is_ascii_digit());
        let at = chunks
            .iter()
            .rposition(|chunk| !chunk.is_empty() && is_number(chunk))?;
        let (before, rest) = chunks.split_at(at);
        let (domain, names) = rest.split_first()?;
        let namespace = if names.is_empty() {
            EMPTY.to_owned()
        } else {
            mangled(names.iter().copied())
        };
        let topic = mangled(names.iter().copied().chain(self.topic.split('/')));
        let Self {
            dds_type,
            hash,
            node,
            session,
            number,
            ..
        } = self;
        let mark = [before, &[MARK]].concat().join("/");
        let entity = |id: u64, kind: &str| {
            format!("{mark}/{domain}/{session}/{number}/{id}/{kind}/{EMPTY}/{namespace}/{node}")
        };
        let publisher = entity(number + 1, PUBLISHER);
        Some([
            entity(*number, NODE),
            format!("{publisher}/{topic}/{dds_type}/{hash}/{LATCHED}"),
        ])
    }

    /// Key expressions of such tokens, of any session, domain and namespace.
    pub fn token_expressions(topic: &str, dds_type: &str, node: &str) -> Vec<String> {
        let topic = mangled(topic.split('/'));
        let entity = |kind: &str| format!("{MARK}/*/*/*/*/{kind}/{EMPTY}/*/{node}");
        let own = [
            entity(NODE),
            format!("{}/$*{topic}/{dds_type}/*/*", entity(PUBLISHER)),
        ];
        let spaced = own.clone().map(|text| format!("*/{text}"));
        own.into_iter().chain(spaced).collect()
    }
}

/// Joins a fully qualified name with the placeholders of slashes.
fn mangled<'n>(names: impl Iterator<Item = &'n str>) -> String {
    names.fold(String::new(), |mut text, name| {
        text.push(SLASH_OF_RMW);
        text.push_str(name);
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_topic_of_ours_is_announced_as_its_node_would() {
        let string = "std_msgs::msg::dds_::String_";
        let topic = |prefix| LatchedTopic {
            prefix,
            topic: "calibration/approved",
            dds_type: string,
            hash: "RIHS01_df66",
            node: "fleetcal",
            session: "3f2a",
            number: 4,
        };
        let [node, publisher] = topic("0/tugger_01").tokens().unwrap();
        assert_eq!(node, "@ros2_lv/0/3f2a/4/4/NN/%/%tugger_01/fleetcal");
        let wanted = format!(
            "@ros2_lv/0/3f2a/4/5/MP/%/%tugger_01/fleetcal/%tugger_01%calibration%approved/\
             {string}/RIHS01_df66/:1:,1:,:,:,,"
        );
        assert_eq!(publisher, wanted);
        for (prefix, before) in [
            ("0/tugger_01", "@ros2_lv/0/"),
            ("7", "@ros2_lv/7/"),
            ("7/site/cart", "@ros2_lv/7/"),
            ("tugger_01/0", "tugger_01/@ros2_lv/0/"),
        ] {
            let [node, publisher] = topic(prefix).tokens().unwrap();
            assert!(node.starts_with(before), "{node}");
            assert_eq!(Announcement::of_token(&node), None);
            let read = Announcement::of_token(&publisher).unwrap();
            assert_eq!(read.path, format!("{prefix}/calibration/approved"));
            assert_eq!(read.type_name, "std_msgs/msg/String");
            assert_eq!(read.layout, KeyLayout::RmwZenoh);
        }
        let [node, _] = topic("7").tokens().unwrap();
        assert_eq!(node, "@ros2_lv/7/3f2a/4/4/NN/%/%/fleetcal");
        for prefix in ["tugger_01", "", "site/tugger_01", "/"] {
            assert_eq!(topic(prefix).tokens(), None, "{prefix}");
        }
    }

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
