//! Names of ROS 2 topics in Zenoh: data keys, liveliness tokens, attachments.
//!
//! | layout | key |
//! |---|---|
//! | `rmw_zenoh` | `{domain}/{namespace…}/{topic…}/{type}/{hash}` |
//! | `rmw_zenoh` of Humble | the same, with `TypeHashNotSupported` for the hash |
//! | `zenoh-bridge-ros2dds` | `{namespace…}/{topic…}` |
//!
//! What stands before type and hash is called the topic's path here.

mod attachment;
mod template;
mod token;

pub use attachment::{Attachment, GID_BYTES};
pub use template::{KeyTemplate, Matched, TemplateRefused};
pub use token::{Announcement, LatchedTopic, TOKENS_OF_BRIDGE, TOKENS_OF_RMW};

use serde::{Deserialize, Serialize};

use crate::message_type::MessageType;

/// Placeholder of the hash in keys of Humble.
pub const NO_HASH: &str = "TypeHashNotSupported";
/// Part of a key of `rmw_zenoh` that distinguishes the type of a message from its topic.
const DDS_TYPE_PART: &str = "::msg::dds_::";

/// Layout of the keys of a robot's topics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum KeyLayout {
    /// `rmw_zenoh` with the type's hash: Iron and newer.
    RmwZenoh,
    /// `rmw_zenoh` without: Humble.
    RmwZenohWithoutHash,
    /// `zenoh-bridge-ros2dds`.
    BridgeRos2dds,
}

/// Parsed key of a topic's messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicKey<'k> {
    /// Part before type and hash: `0/tugger_01/scan`, or for a bridge `tugger_01/scan`.
    pub path: &'k str,
    /// Layout of the key.
    pub layout: KeyLayout,
    /// The type, if the key has it, in its spelling there.
    pub type_name: Option<&'k str>,
}

impl<'k> TopicKey<'k> {
    /// Parses a key; one without a type counts as a key of the bridge.
    pub fn parse(key: &'k str) -> Self {
        let typed = key.rsplit_once('/').and_then(|(front, hash)| {
            let (path, type_name) = front.rsplit_once('/')?;
            type_name.contains(DDS_TYPE_PART).then(|| Self {
                path,
                layout: layout_of_hash(hash),
                type_name: Some(type_name),
            })
        });
        typed.unwrap_or(Self {
            path: key,
            layout: KeyLayout::BridgeRos2dds,
            type_name: None,
        })
    }

    /// Returns the type, if it is one of [`MessageType`].
    pub fn message_type(&self) -> Option<MessageType> {
        self.type_name.and_then(MessageType::of_ros_type)
    }
}

fn layout_of_hash(hash: &str) -> KeyLayout {
    if hash == NO_HASH {
        KeyLayout::RmwZenohWithoutHash
    } else {
        KeyLayout::RmwZenoh
    }
}

/// Key expression of the messages on a path whose keys have this name of a type, whatever their hash.
pub fn typed_expression(path: &str, type_name: &str) -> String {
    format!("{path}/{type_name}/*")
}

/// Key expressions of a type's messages on a path: one for each name of the type.
pub fn typed_expressions(path: &str, message_type: MessageType) -> impl Iterator<Item = String> {
    let names = message_type.dds_types();
    names.map(move |name| typed_expression(path, &name))
}

/// Key of a type's messages on a path in the form of Humble, without a hash.
pub fn typed_key(path: &str, message_type: MessageType) -> String {
    format!("{path}/{}/{NO_HASH}", message_type.dds_type())
}

/// Converts a type's spellings in keys and tokens to that of ROS 2, `sensor_msgs/msg/Image`.
fn ros_type_name(name: &str) -> String {
    let parts = name
        .split(['/', '\u{a7}'])
        .flat_map(|part| part.split("::"));
    let parts: Vec<&str> = parts
        .filter(|part| !part.is_empty() && *part != "dds_")
        .collect();
    let joined = parts.join("/");
    // Only the spelling of DDS ends in an underscore.
    match joined.strip_suffix('_') {
        Some(plain) if name.contains("dds_") => plain.to_owned(),
        _ => joined,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_of_each_layout_are_taken_apart() {
        let scan = "sensor_msgs::msg::dds_::LaserScan_";
        let cases = [
            (
                format!("0/tugger_01/front/scan/{scan}/RIHS01_64c1"),
                "0/tugger_01/front/scan",
                KeyLayout::RmwZenoh,
            ),
            (
                format!("0/tugger_01/scan/{scan}/{NO_HASH}"),
                "0/tugger_01/scan",
                KeyLayout::RmwZenohWithoutHash,
            ),
            (
                "tugger_01/scan".to_owned(),
                "tugger_01/scan",
                KeyLayout::BridgeRos2dds,
            ),
        ];
        for (key, path, layout) in cases {
            let parsed = TopicKey::parse(&key);
            assert_eq!((parsed.path, parsed.layout), (path, layout), "{key}");
            let typed = layout != KeyLayout::BridgeRos2dds;
            assert_eq!(
                parsed.message_type(),
                typed.then_some(MessageType::LaserScan)
            );
        }
        for strange in ["", "/", "a", "//", "a//"] {
            assert_eq!(TopicKey::parse(strange).type_name, None);
        }
    }

    #[test]
    fn type_names_of_every_spelling_are_those_of_ros() {
        for name in [
            "sensor_msgs::msg::dds_::Image_",
            "sensor_msgs\u{a7}msg\u{a7}Image",
            "sensor_msgs/msg/Image",
        ] {
            assert_eq!(ros_type_name(name), "sensor_msgs/msg/Image");
        }
    }
}
