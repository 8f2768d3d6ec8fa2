//! Wire formats: message types, CDR and JSON codecs, key expressions. No I/O.
//!
//! A robot's streams are ROS 2 messages, in CDR or in JSON. What the service answers is JSON: the
//! same documents on Zenoh, over HTTP and from `fleetcal calibrate --json`. Units are SI and
//! radians, and stand last in the names.

pub mod audit_head;
pub mod calibration;
pub mod cdr;
pub mod certificate;
pub mod description;
pub mod encoding;
pub mod endpoint;
pub mod estimate;
pub mod event;
pub mod key;
pub mod key_change;
pub mod message_type;
pub mod offer;
pub mod progress;
mod recording_topic;
pub mod ros;
pub mod ros2_key;
pub mod signing;

pub use encoding::{DecodeError, Encoding};
pub use fleetcal_model::RobotId;
pub use key::{Key, KeyRoot, Keys, StreamKind};
pub use message_type::{Form, MessageType, ScanType};
pub use recording_topic::RecordingTopic;
pub use ros::RosMessage;
