//! Which topics of a recording to use.

use fleetcal_proto::ros::{AckermannDriveStamped, LaserScan, Odometry, PointCloud2, RosMessage};
use thiserror::Error;

use super::Channel;

/// What the LiDAR's motion is taken from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ChosenPose {
    /// Raw sweeps, or the clouds of a 3D scanner: the channel's type tells.
    Scan(Channel),
    /// Poses of a LiDAR odometry that ran on the robot.
    LidarOdometry(Channel),
}

impl ChosenPose {
    /// The channel.
    pub fn channel(&self) -> &Channel {
        match self {
            Self::Scan(channel) | Self::LidarOdometry(channel) => channel,
        }
    }
}

/// The topics of a calibration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topics {
    /// Measured speed and steering.
    pub drive: Channel,
    /// The LiDAR's sweeps or poses.
    pub pose: ChosenPose,
}

impl Topics {
    /// The names of both.
    pub fn names(&self) -> [&str; 2] {
        [&self.drive.topic, &self.pose.channel().topic]
    }

    /// The first chunk of the drive topic, as which the robot is known unless told otherwise:
    /// `tugger_01` of `/tugger_01/drive`. `None` when the topic has only one chunk.
    pub fn robot(&self) -> Option<&str> {
        let chunks = self.drive.topic.trim_start_matches('/');
        chunks.split_once('/').map(|(robot, _)| robot)
    }
}

/// Why the topics of a recording could not be chosen.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum TopicError {
    /// The recording lacks what is needed.
    #[error("the recording has no {what} topic ({needed}); it has {present}")]
    Missing {
        /// What is missing.
        what: &'static str,
        /// The message types that would do.
        needed: String,
        /// The topics it has, with their types.
        present: String,
    },
    /// More than one topic would do and none was chosen.
    #[error("{count} {what} topics would do: {candidates}; choose one with {flag}")]
    Ambiguous {
        /// What they are for.
        what: &'static str,
        /// How many there are.
        count: usize,
        /// Their names.
        candidates: String,
        /// The flag that chooses.
        flag: &'static str,
    },
    /// The topic that was asked for is not in the recording.
    #[error("{flag} is {topic:?}, accepted are the recording's topics: {present}")]
    NotInRecording {
        /// The flag.
        flag: &'static str,
        /// Its value.
        topic: String,
        /// The topics it has, with their types.
        present: String,
    },
    /// The topic that was asked for is of another type.
    #[error("{flag} is {topic:?}, which is of type {found}, accepted is {needed}")]
    WrongType {
        /// The flag.
        flag: &'static str,
        /// Its value.
        topic: String,
        /// Its type, and its encoding where that is the trouble.
        found: String,
        /// The types that would do.
        needed: String,
    },
    /// Two flags that exclude each other.
    #[error("--scan-topic and --pose-topic are both given, accepted is one of them")]
    ScanAndPose,
}

impl TopicError {
    /// The command's exit status: 2 for what the caller can mend, 65 when the recording lacks
    /// what is needed.
    pub fn exit_status(&self) -> u8 {
        match self {
            Self::Missing { .. } => 65,
            _ => 2,
        }
    }
}

/// What a topic is wanted for.
struct Wanted {
    what: &'static str,
    flag: &'static str,
    /// The types that would do, the preferred first.
    message_types: &'static [&'static str],
}

impl Wanted {
    fn needed(&self) -> String {
        self.message_types.join(" or ")
    }
}

const DRIVE: Wanted = Wanted {
    what: "drive",
    flag: "--drive-topic",
    message_types: &[AckermannDriveStamped::TYPE],
};
const SCAN: Wanted = Wanted {
    what: "scan",
    flag: "--scan-topic",
    message_types: &[LaserScan::TYPE, PointCloud2::TYPE],
};
const POSE: Wanted = Wanted {
    what: "LiDAR pose",
    flag: "--pose-topic",
    message_types: &[Odometry::TYPE],
};

/// Chooses the topics of a calibration: those asked for, else by message type when only one would
/// do. Sweeps are preferred to poses, unless a pose topic is asked for.
///
/// # Errors
/// Says what is missing, lists the candidates, or names the flag that can't be.
pub fn choose_topics(
    channels: &[Channel],
    drive_topic: Option<&str>,
    scan_topic: Option<&str>,
    pose_topic: Option<&str>,
) -> Result<Topics, TopicError> {
    let drive = choose(channels, &DRIVE, drive_topic)?
        .ok_or_else(|| missing(channels, DRIVE.what, DRIVE.needed()))?;
    let pose = match (scan_topic, pose_topic) {
        (Some(_), Some(_)) => return Err(TopicError::ScanAndPose),
        (None, Some(_)) => choose(channels, &POSE, pose_topic)?.map(ChosenPose::LidarOdometry),
        (scan_topic, None) => match choose(channels, &SCAN, scan_topic)? {
            Some(scan) => Some(ChosenPose::Scan(scan)),
            None => choose(channels, &POSE, None)?.map(ChosenPose::LidarOdometry),
        },
    };
    let needed = || format!("{} or {}", SCAN.needed(), POSE.needed());
    let pose = pose.ok_or_else(|| missing(channels, "scan or LiDAR pose", needed()))?;
    Ok(Topics { drive, pose })
}

/// Chooses the topic with sweeps: the one asked for, else the only one; clouds when there are no
/// sweeps.
///
/// # Errors
/// Says that there is none, lists the candidates, or names the flag that can't be.
pub fn choose_scan_topic(
    channels: &[Channel],
    scan_topic: Option<&str>,
) -> Result<Channel, TopicError> {
    choose(channels, &SCAN, scan_topic)?.ok_or_else(|| missing(channels, SCAN.what, SCAN.needed()))
}

/// The topic asked for, or the only one of the preferred type that there is; `None` when there is
/// none of any.
fn choose(
    channels: &[Channel],
    wanted: &Wanted,
    asked: Option<&str>,
) -> Result<Option<Channel>, TopicError> {
    if let Some(topic) = asked {
        return asked_for(channels, wanted, topic).map(Some);
    }
    let of_type = |message_type: &&str| -> Vec<&Channel> {
        let fits = |channel: &&Channel| {
            channel.message_type == *message_type && channel.encoding.is_some()
        };
        channels.iter().filter(fits).collect()
    };
    let mut candidates = wanted.message_types.iter().map(of_type);
    match candidates.find(|of_type| !of_type.is_empty()).as_deref() {
        None | Some([]) => Ok(None),
        Some([only]) => Ok(Some((*only).clone())),
        Some(several) => {
            let names: Vec<&str> = several
                .iter()
                .map(|channel| channel.topic.as_str())
                .collect();
            Err(TopicError::Ambiguous {
                what: wanted.what,
                count: several.len(),
                candidates: names.join(", "),
                flag: wanted.flag,
            })
        }
    }
}

fn asked_for(channels: &[Channel], wanted: &Wanted, topic: &str) -> Result<Channel, TopicError> {
    let fits = |channel: &&Channel| {
        wanted
            .message_types
            .contains(&channel.message_type.as_str())
            && channel.encoding.is_some()
    };
    let of_name = || channels.iter().filter(|channel| channel.topic == topic);
    if let Some(channel) = of_name().find(fits) {
        return Ok(channel.clone());
    }
    let flag = wanted.flag;
    let topic = topic.to_owned();
    match of_name().next() {
        None => Err(TopicError::NotInRecording {
            flag,
            topic,
            present: present(channels),
        }),
        Some(other) => {
            let found = shown_type(other);
            Err(TopicError::WrongType {
                flag,
                topic,
                found,
                needed: wanted.needed(),
            })
        }
    }
}

fn missing(channels: &[Channel], what: &'static str, needed: String) -> TopicError {
    TopicError::Missing {
        what,
        needed,
        present: present(channels),
    }
}

/// Most topics that an error lists.
const LISTED_MAX: usize = 20;

fn present(channels: &[Channel]) -> String {
    let listed = channels.iter().take(LISTED_MAX);
    let mut names: Vec<String> = listed
        .map(|channel| format!("{} ({})", channel.topic, shown_type(channel)))
        .collect();
    if channels.len() > LISTED_MAX {
        names.push(format!("{} more", channels.len() - LISTED_MAX));
    }
    names.join(", ")
}

fn shown_type(channel: &Channel) -> String {
    let name = match channel.message_type.as_str() {
        "" => "of unknown type",
        name => name,
    };
    match channel.encoding {
        Some(_) => name.to_owned(),
        None => format!("{name}, neither CDR nor JSON"),
    }
}
