//! Key expressions: what is sent where. Built and parsed here and nowhere else.
//!
//! A key is `{root}/{robot}/{stream}`, or `{root}/@alive/{robot}` and `{root}/@service/{instance}`
//! for liveliness tokens, or `{root}/@digest/{instance}` for what instances of one cluster tell each
//! other. A chunk that begins with `@` is not matched by `*` or `**`.

use std::fmt;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use fleetcal_model::{RobotId, RobotIdRefused};

/// Root chunk unless configured.
pub const ROOT_DEFAULT: &str = "fleet";
/// Longest key that is parsed, in bytes; longer ones are refused unread.
pub const KEY_BYTES_MAX: usize = 255;

/// Name of wheel odometry until version 0.2, when it got one that does not suggest a command.
const FORMER_WHEEL_ODOMETRY: &str = "drive";
const ALIVE: &str = "@alive";
const SERVICE: &str = "@service";
const DIGEST: &str = "@digest";

/// Content of a key under a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum StreamKind {
    /// Measured speed and steering, `ackermann_msgs/msg/AckermannDriveStamped`.
    WheelOdometry,
    /// Raw scans, `sensor_msgs/msg/LaserScan`.
    Scan,
    /// The LiDAR's pose instead of scans, `nav_msgs/msg/Odometry`.
    LidarOdometry,
    /// Events of the robot, [`crate::event::RobotEvent`].
    Event,
    /// The service's estimate, [`crate::estimate::EstimateDocument`].
    Estimate,
    /// The approved calibration, [`crate::calibration::Envelope`].
    CalibrationApproved,
    /// The robot's acknowledgement, [`crate::calibration::Applied`].
    CalibrationApplied,
    /// The service's confirmation, [`crate::calibration::Confirmed`].
    CalibrationConfirmed,
    /// The path follower's error, [`crate::event::CrossTrackError`].
    CrossTrackError,
    /// Progress of the service with the robot's messages, [`crate::progress::Progress`].
    Progress,
    /// The robot's description, a URDF in a `std_msgs/msg/String`.
    RobotDescription,
    /// The robot's static transforms, `tf2_msgs/msg/TFMessage`.
    TfStatic,
}

impl StreamKind {
    /// All kinds.
    pub const ALL: [Self; 12] = [
        Self::WheelOdometry,
        Self::Scan,
        Self::LidarOdometry,
        Self::Event,
        Self::Estimate,
        Self::CalibrationApproved,
        Self::CalibrationApplied,
        Self::CalibrationConfirmed,
        Self::CrossTrackError,
        Self::Progress,
        Self::RobotDescription,
        Self::TfStatic,
    ];

    /// Returns the chunks behind the robot's: `wheel_odometry`, `calibration/approved` and so on.
    pub const fn suffix(self) -> &'static str {
        match self {
            Self::WheelOdometry => "wheel_odometry",
            Self::Scan => "scan",
            Self::LidarOdometry => "lidar_odometry",
            Self::Event => "event",
            Self::Estimate => "estimate",
            Self::CalibrationApproved => "calibration/approved",
            Self::CalibrationApplied => "calibration/applied",
            Self::CalibrationConfirmed => "calibration/confirmed",
            Self::CrossTrackError => "cross_track_error",
            Self::Progress => "progress",
            Self::RobotDescription => "robot_description",
            Self::TfStatic => "tf_static",
        }
    }

    fn from_suffix(suffix: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.suffix() == suffix)
    }
}

impl fmt::Display for StreamKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.suffix())
    }
}

/// Root chunk of all keys, `fleet` unless configured. Same characters as a robot's id.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct KeyRoot(Arc<str>);

impl KeyRoot {
    /// Checks a text and makes it a root.
    ///
    /// # Errors
    /// When it is not one chunk of the characters a robot's id may have.
    pub fn parse(text: &str) -> Result<Self, KeyRefused> {
        chunk(text).map(Self).map_err(KeyRefused::Root)
    }

    /// Returns the root as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl Default for KeyRoot {
    fn default() -> Self {
        Self(Arc::from(ROOT_DEFAULT))
    }
}

impl TryFrom<String> for KeyRoot {
    type Error = KeyRefused;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        Self::parse(&text)
    }
}

impl From<KeyRoot> for String {
    fn from(root: KeyRoot) -> Self {
        root.as_str().to_owned()
    }
}

/// Name of one service instance in its liveliness token. Same characters as a robot's id.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct ServiceInstance(Arc<str>);

impl ServiceInstance {
    /// Checks a text and makes it an instance's name.
    ///
    /// # Errors
    /// When it is not one chunk of the characters a robot's id may have.
    pub fn parse(text: &str) -> Result<Self, KeyRefused> {
        chunk(text).map(Self).map_err(KeyRefused::Instance)
    }

    /// Returns the name as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl TryFrom<String> for ServiceInstance {
    type Error = KeyRefused;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        Self::parse(&text)
    }
}

impl From<ServiceInstance> for String {
    fn from(instance: ServiceInstance) -> Self {
        instance.as_str().to_owned()
    }
}

fn chunk(text: &str) -> Result<Arc<str>, RobotIdRefused> {
    RobotId::parse(text).map(|checked| Arc::from(checked.as_str()))
}

/// Reason for which a text is not a key of ours.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum KeyRefused {
    /// The key is longer than [`KEY_BYTES_MAX`].
    #[error("key: got {length} bytes, expected at most 255")]
    TooLong {
        /// Its length in bytes.
        length: usize,
    },
    /// The key holds a wildcard, so that it names many keys.
    #[error("key {key:?} contains {character:?}, expected the key of one stream")]
    Wildcard {
        /// The key.
        key: String,
        /// The wildcard's character.
        character: char,
    },
    /// The key has two slashes in a row, or one at an end.
    #[error("key {key:?} has an empty chunk, expected chunks parted by one slash")]
    EmptyChunk {
        /// The key.
        key: String,
    },
    /// The key is under another root.
    #[error("key: got {key:?}, expected {root}/{{robot}}/{{stream}}")]
    OtherRoot {
        /// The key.
        key: String,
        /// The configured root.
        root: String,
    },
    /// The robot chunk is not a robot id.
    #[error("key {key:?}: {reason}")]
    Robot {
        /// The key.
        key: String,
        /// Fault of the id.
        #[source]
        reason: RobotIdRefused,
    },
    /// The stream is unknown.
    #[error(
        "key {key:?} ends in {stream:?}, expected wheel_odometry, scan, lidar_odometry, event, \
         estimate, calibration/{{approved,applied,confirmed}}, cross_track_error, progress, \
         robot_description and tf_static"
    )]
    UnknownStream {
        /// The key.
        key: String,
        /// Chunks behind the robot's.
        stream: String,
    },
    /// The configured root is not a chunk.
    #[error("key root: {0}")]
    Root(#[source] RobotIdRefused),
    /// The service's name is not a chunk.
    #[error("service instance: {0}")]
    Instance(#[source] RobotIdRefused),
}

/// Parsed key.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Key {
    /// `{root}/{robot}/{stream}`.
    Stream {
        /// Id of the robot.
        robot: RobotId,
        /// Kind of the stream.
        kind: StreamKind,
    },
    /// `{root}/{robot}/drive`: the former key of wheel odometry. Its messages are not used.
    FormerWheelOdometry(RobotId),
    /// `{root}/@alive/{robot}`: the token of a robot that is present.
    Alive(RobotId),
    /// `{root}/@service/{instance}`: the token of a service that is present.
    Service(ServiceInstance),
    /// `{root}/@digest/{instance}`: the reports of an instance of a cluster on its robots for the
    /// others.
    Digest(ServiceInstance),
}

/// Builder and parser of the keys under one root.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Keys {
    root: KeyRoot,
}

impl Keys {
    /// Makes the keys under `root`.
    pub fn new(root: KeyRoot) -> Self {
        Self { root }
    }

    /// Returns the root.
    pub fn root(&self) -> &KeyRoot {
        &self.root
    }

    /// Key of one robot's stream, `fleet/tugger_01/wheel_odometry`.
    pub fn stream(&self, robot: &RobotId, kind: StreamKind) -> String {
        format!("{}/{robot}/{}", self.root.as_str(), kind.suffix())
    }

    /// Former key of a robot's wheel odometry, `fleet/tugger_01/drive`.
    pub fn former_wheel_odometry(&self, robot: &RobotId) -> String {
        format!("{}/{robot}/{FORMER_WHEEL_ODOMETRY}", self.root.as_str())
    }

    /// Key expression of every robot's former key of wheel odometry, `fleet/*/drive`.
    pub fn former_wheel_odometry_of_all(&self) -> String {
        format!("{}/*/{FORMER_WHEEL_ODOMETRY}", self.root.as_str())
    }

    /// Key expression of every robot's stream of a kind, `fleet/*/wheel_odometry`.
    pub fn stream_of_all(&self, kind: StreamKind) -> String {
        format!("{}/*/{}", self.root.as_str(), kind.suffix())
    }

    /// Key expression of every stream of every robot whose name is one chunk, `fleet/*/*`.
    pub fn stream_of_all_kinds(&self) -> String {
        format!("{}/*/*", self.root.as_str())
    }

    /// Key of a robot's liveliness token, `fleet/@alive/tugger_01`.
    pub fn alive(&self, robot: &RobotId) -> String {
        format!("{}/{ALIVE}/{robot}", self.root.as_str())
    }

    /// Key expression of every robot's liveliness token, `fleet/@alive/*`.
    pub fn alive_of_all(&self) -> String {
        format!("{}/{ALIVE}/*", self.root.as_str())
    }

    /// Key of a service's liveliness token, `fleet/@service/a1b2`.
    pub fn service(&self, instance: &ServiceInstance) -> String {
        format!("{}/{SERVICE}/{}", self.root.as_str(), instance.as_str())
    }

    /// Key expression of every service's liveliness token, `fleet/@service/*`.
    pub fn service_of_all(&self) -> String {
        format!("{}/{SERVICE}/*", self.root.as_str())
    }

    /// Key of an instance's reports on its robots for the others, `fleet/@digest/a`.
    pub fn digest(&self, instance: &ServiceInstance) -> String {
        format!("{}/{DIGEST}/{}", self.root.as_str(), instance.as_str())
    }

    /// Key expression of every instance's reports, `fleet/@digest/*`.
    pub fn digest_of_all(&self) -> String {
        format!("{}/{DIGEST}/*", self.root.as_str())
    }

    /// Key expression of every stream of one robot whose name is one chunk, `fleet/tugger_01/*`.
    pub fn stream_of_any_kind(&self, robot: &RobotId) -> String {
        format!("{}/{robot}/*", self.root.as_str())
    }

    /// Key expression of everything under the root except the `@` chunks, `fleet/**`.
    pub fn everything(&self) -> String {
        format!("{}/**", self.root.as_str())
    }

    /// Parses a key.
    ///
    /// # Errors
    /// When it is not a key of one stream under this root: the sentence names the key and the
    /// accepted form.
    pub fn parse(&self, key: &str) -> Result<Key, KeyRefused> {
        if key.len() > KEY_BYTES_MAX {
            return Err(KeyRefused::TooLong { length: key.len() });
        }
        if let Some(character) = key.chars().find(|c| matches!(c, '*' | '$' | '?' | '#')) {
            return Err(KeyRefused::Wildcard {
                key: key.to_owned(),
                character,
            });
        }
        if key.split('/').any(str::is_empty) {
            return Err(KeyRefused::EmptyChunk {
                key: key.to_owned(),
            });
        }
        let other_root = || KeyRefused::OtherRoot {
            key: key.to_owned(),
            root: self.root.as_str().to_owned(),
        };
        let below_root = key
            .strip_prefix(self.root.as_str())
            .and_then(|rest| rest.strip_prefix('/'))
            .ok_or_else(other_root)?;
        let (first, rest) = below_root.split_once('/').ok_or_else(other_root)?;
        let robot = |text: &str| {
            RobotId::parse(text).map_err(|reason| KeyRefused::Robot {
                key: key.to_owned(),
                reason,
            })
        };
        match first {
            ALIVE => robot(rest).map(Key::Alive),
            SERVICE => ServiceInstance::parse(rest).map(Key::Service),
            DIGEST => ServiceInstance::parse(rest).map(Key::Digest),
            _ => {
                let robot = robot(first)?;
                if rest == FORMER_WHEEL_ODOMETRY {
                    return Ok(Key::FormerWheelOdometry(robot));
                }
                let kind =
                    StreamKind::from_suffix(rest).ok_or_else(|| KeyRefused::UnknownStream {
                        key: key.to_owned(),
                        stream: rest.to_owned(),
                    })?;
                Ok(Key::Stream { robot, kind })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn robot() -> RobotId {
        RobotId::parse("tugger_01").unwrap()
    }

    #[test]
    fn what_is_built_parses_back() {
        for root in ["fleet", "plant-3"] {
            let keys = Keys::new(KeyRoot::parse(root).unwrap());
            for kind in StreamKind::ALL {
                let key = keys.stream(&robot(), kind);
                assert_eq!(
                    keys.parse(&key),
                    Ok(Key::Stream {
                        robot: robot(),
                        kind
                    })
                );
            }
            let former = keys.former_wheel_odometry(&robot());
            assert_eq!(keys.parse(&former), Ok(Key::FormerWheelOdometry(robot())));
            assert_eq!(keys.parse(&keys.alive(&robot())), Ok(Key::Alive(robot())));
            let instance = ServiceInstance::parse("a1b2").unwrap();
            assert_eq!(
                keys.parse(&keys.service(&instance)),
                Ok(Key::Service(instance.clone()))
            );
            let digest = keys.digest(&instance);
            assert_eq!(keys.parse(&digest), Ok(Key::Digest(instance)));
        }
    }

    #[test]
    fn the_spelling_is_that_of_the_wire() {
        let keys = Keys::default();
        assert_eq!(
            keys.stream(&robot(), StreamKind::WheelOdometry),
            "fleet/tugger_01/wheel_odometry"
        );
        assert_eq!(
            keys.stream(&robot(), StreamKind::CalibrationApproved),
            "fleet/tugger_01/calibration/approved"
        );
        assert_eq!(keys.stream_of_all(StreamKind::Scan), "fleet/*/scan");
        assert_eq!(keys.alive(&robot()), "fleet/@alive/tugger_01");
        assert_eq!(keys.service_of_all(), "fleet/@service/*");
        assert_eq!(keys.digest_of_all(), "fleet/@digest/*");
        assert_eq!(keys.stream_of_any_kind(&robot()), "fleet/tugger_01/*");
    }

    #[test]
    fn each_refusal_says_what_is_wrong() {
        let keys = Keys::default();
        let cases = [
            ("fleet/*/wheel_odometry", "contains '*'"),
            ("fleet/a$*/wheel_odometry", "contains '$'"),
            ("fleet//wheel_odometry", "empty chunk"),
            ("/fleet/a/wheel_odometry", "empty chunk"),
            ("fleet/a/wheel_odometry/", "empty chunk"),
            ("fleet", "got \"fleet\", expected fleet/{robot}/"),
            ("fleet/a", "got \"fleet/a\", expected fleet/{robot}/"),
            (
                "fleets/a/wheel_odometry",
                "got \"fleets/a/wheel_odometry\", expected fleet/{robot}/",
            ),
            ("fleet/@robot/wheel_odometry", "contains '@'"),
            ("fleet/@alive/@a", "contains '@'"),
            ("fleet/@alive/a/b", "contains '/'"),
            ("fleet/@service/a b", "contains ' '"),
            ("fleet/@digest/a/b", "contains '/'"),
            ("fleet/a/camera", "ends in \"camera\""),
            (
                "fleet/a/wheel_odometry/raw",
                "ends in \"wheel_odometry/raw\"",
            ),
        ];
        for (key, wanted) in cases {
            let sentence = keys.parse(key).unwrap_err().to_string();
            assert!(sentence.contains(wanted), "{key:?} gave {sentence:?}");
            assert!(sentence.contains("expected"), "{key:?} gave {sentence:?}");
        }
        assert!(
            keys.parse(&"a".repeat(256))
                .unwrap_err()
                .to_string()
                .contains("256 bytes")
        );
        assert!(KeyRoot::parse("a/b").is_err());
    }
}
