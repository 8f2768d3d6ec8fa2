//! Topics of a recording to use.

use fleetcal_proto::message_type::MessageType;
use thiserror::Error;

use super::Channel;

/// Channels of speed and steering.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ChosenWheelOdometry {
    /// Speed and steering are in the same messages.
    Whole(Channel),
    /// Speed and steering are on topics of their own, to be paired by stamp.
    Halves {
        /// Steering.
        steering: Channel,
        /// Speed.
        speed: Channel,
    },
}

impl ChosenWheelOdometry {
    /// Returns the channels.
    pub fn channels(&self) -> Vec<&Channel> {
        match self {
            Self::Whole(drive) => vec![drive],
            Self::Halves { steering, speed } => vec![steering, speed],
        }
    }
}

/// Source of the LiDAR's motion.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ChosenPose {
    /// Raw scans, or the clouds of a 3D scanner, by the channel's type.
    Scan(Channel),
    /// Poses of a LiDAR odometry that ran on the robot.
    LidarOdometry(Channel),
}

impl ChosenPose {
    /// Returns the channel.
    pub fn channel(&self) -> &Channel {
        match self {
            Self::Scan(channel) | Self::LidarOdometry(channel) => channel,
        }
    }
}

/// Topics of a calibration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topics {
    /// Measured speed and steering.
    pub wheel_odometry: ChosenWheelOdometry,
    /// The LiDAR's scans or poses.
    pub pose: ChosenPose,
}

impl Topics {
    /// Returns the channels, those of the wheel odometry first.
    pub fn channels(&self) -> Vec<&Channel> {
        let mut channels = self.wheel_odometry.channels();
        channels.push(self.pose.channel());
        channels
    }

    /// Returns all names.
    pub fn names(&self) -> Vec<&str> {
        let channels = self.channels().into_iter();
        channels.map(|channel| channel.topic.as_str()).collect()
    }

    /// Returns the topic that identifies the robot: of the wheel odometry, or of the steering.
    pub fn wheel_odometry_topic(&self) -> &str {
        match &self.wheel_odometry {
            ChosenWheelOdometry::Whole(channel)
            | ChosenWheelOdometry::Halves {
                steering: channel, ..
            } => &channel.topic,
        }
    }

    /// Returns the first chunk of the wheel odometry topic, the robot's default name: `tugger_01`
    /// of `/tugger_01/wheel_odometry`. `None` if the topic has only one chunk.
    pub fn robot(&self) -> Option<&str> {
        let chunks = self.wheel_odometry_topic().trim_start_matches('/');
        chunks.split_once('/').map(|(robot, _)| robot)
    }
}

/// A requested topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AskedTopic {
    /// Its name in the recording.
    pub topic: String,
    /// Flag, or key of a configuration, that requests it.
    pub by: &'static str,
}

/// Requested topics; the others are found by their types.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct AskedTopics {
    /// Speed and steering in one.
    pub wheel_odometry: Option<AskedTopic>,
    /// Steering alone.
    pub steering: Option<AskedTopic>,
    /// Speed alone.
    pub speed: Option<AskedTopic>,
    /// Scans or clouds.
    pub scan: Option<AskedTopic>,
    /// Poses of the LiDAR.
    pub pose: Option<AskedTopic>,
}

/// Reason for which the topics of a recording could not be chosen.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum TopicError {
    /// The recording lacks a required topic.
    #[error("the recording has no {what} topic ({needed}); it has {present}")]
    Missing {
        /// Missing content.
        what: &'static str,
        /// Message types that are accepted.
        needed: String,
        /// Topics of the recording, with their types.
        present: String,
    },
    /// More than one topic is suitable and none was chosen.
    #[error("{count} {what} topics would do: {candidates}; choose one with {flag}")]
    Ambiguous {
        /// Their content.
        what: &'static str,
        /// Number of suitable topics.
        count: usize,
        /// Their names.
        candidates: String,
        /// The flag that chooses.
        flag: &'static str,
    },
    /// The requested topic is not in the recording.
    #[error("{flag}: got {topic:?}, expected the recording's topics: {present}")]
    NotInRecording {
        /// The flag.
        flag: &'static str,
        /// Its value.
        topic: String,
        /// Topics of the recording, with their types.
        present: String,
    },
    /// The requested topic is of another type.
    #[error("{flag}: got {topic:?} of type {found}, expected {needed}")]
    WrongType {
        /// The flag.
        flag: &'static str,
        /// Its value.
        topic: String,
        /// Its type, and its encoding if that is at fault.
        found: String,
        /// Accepted types.
        needed: String,
    },
    /// Two flags exclude each other.
    #[error("{scan} and {pose} are both given, expected one of them")]
    ScanAndPose {
        /// Flag that requests scans.
        scan: &'static str,
        /// Flag that requests poses.
        pose: &'static str,
    },
    /// Neither wheel odometry nor both of its halves.
    #[error("{given} given, expected a topic of both steering and speed, or one of each")]
    Halves {
        /// Given flag.
        given: String,
    },
    /// Both halves have the same topic.
    #[error(
        "{steering} and {speed} are both {topic:?}, expected {wheel_odometry} for a topic of both"
    )]
    OneTopic {
        /// Flag that requests the steering.
        steering: &'static str,
        /// Flag that requests the speed.
        speed: &'static str,
        /// The topic.
        topic: String,
        /// The flag of a topic that has both.
        wheel_odometry: &'static str,
    },
}

impl TopicError {
    /// Returns the command's exit status: 2 for errors that the caller can correct, 65 if the
    /// recording lacks a required topic.
    pub fn exit_status(&self) -> u8 {
        match self {
            Self::Missing { .. } => 65,
            _ => 2,
        }
    }
}

/// Purpose of a topic.
struct Wanted {
    what: &'static str,
    flag: &'static str,
    /// Accepted types, the preferred first.
    accepted: &'static [MessageType],
    /// Types of them that are found without a request: topics of the others are too ambiguous.
    found: &'static [MessageType],
}

impl Wanted {
    fn needed(&self) -> String {
        let names: Vec<&str> = self.accepted.iter().map(|of| of.ros_type()).collect();
        names.join(" or ")
    }
}

const WHEEL_ODOMETRY: Wanted = Wanted {
    what: "wheel odometry",
    flag: "--wheel-odometry-topic",
    accepted: MessageType::OF_WHEEL_ODOMETRY,
    found: &[
        MessageType::AckermannDriveStamped,
        MessageType::DriveSamples,
    ],
};
const STEERING: Wanted = Wanted {
    what: "steering",
    flag: "--steering-topic",
    accepted: MessageType::OF_STEERING,
    found: &[MessageType::SteeringReport],
};
const SPEED: Wanted = Wanted {
    what: "speed",
    flag: "--speed-topic",
    accepted: MessageType::OF_SPEED,
    found: &[MessageType::VelocityReport],
};
const SCAN: Wanted = Wanted {
    what: "scan",
    flag: "--scan-topic",
    accepted: MessageType::OF_SCAN,
    found: MessageType::OF_SCAN,
};
const POSE: Wanted = Wanted {
    what: "LiDAR pose",
    flag: "--pose-topic",
    accepted: MessageType::OF_LIDAR_ODOMETRY,
    found: &[MessageType::Odometry],
};

/// Chooses the topics of a calibration: the requested ones, else by message type if only one is
/// suitable. Scans are preferred to poses, unless a pose topic is requested.
///
/// # Errors
/// Names what is missing, lists the candidates, or names the invalid flag.
pub fn choose_topics(channels: &[Channel], asked: &AskedTopics) -> Result<Topics, TopicError> {
    let drive = choose_wheel_odometry(channels, asked)?;
    let pose = match (&asked.scan, &asked.pose) {
        (Some(scan), Some(pose)) => {
            return Err(TopicError::ScanAndPose {
                scan: scan.by,
                pose: pose.by,
            });
        }
        (None, Some(pose)) => Some(ChosenPose::LidarOdometry(asked_for(channels, &POSE, pose)?)),
        (Some(scan), None) => Some(ChosenPose::Scan(asked_for(channels, &SCAN, scan)?)),
        (None, None) => match only_one(channels, &SCAN)? {
            Some(scan) => Some(ChosenPose::Scan(scan)),
            // What tells how the vehicle drives is no pose of its LiDAR.
            None => only_one(&others(channels, &drive), &POSE)?.map(ChosenPose::LidarOdometry),
        },
    };
    let needed = || {
        let (scan, pose, flag) = (SCAN.needed(), POSE.needed(), POSE.flag);
        format!("{scan}; or {pose} of the LiDAR, which {flag} names")
    };
    let pose = pose.ok_or_else(|| missing(channels, "scan or LiDAR pose", needed()))?;
    Ok(Topics {
        wheel_odometry: drive,
        pose,
    })
}

fn others(channels: &[Channel], drive: &ChosenWheelOdometry) -> Vec<Channel> {
    let taken = drive.channels();
    let is_other = |channel: &&Channel| !taken.contains(channel);
    channels.iter().filter(is_other).cloned().collect()
}

fn choose_wheel_odometry(
    channels: &[Channel],
    asked: &AskedTopics,
) -> Result<ChosenWheelOdometry, TopicError> {
    match (&asked.wheel_odometry, &asked.steering, &asked.speed) {
        (Some(drive), None, None) => {
            asked_for(channels, &WHEEL_ODOMETRY, drive).map(ChosenWheelOdometry::Whole)
        }
        (None, Some(steering), Some(speed)) if steering.topic == speed.topic => {
            Err(TopicError::OneTopic {
                steering: steering.by,
                speed: speed.by,
                topic: speed.topic.clone(),
                wheel_odometry: WHEEL_ODOMETRY.flag,
            })
        }
        (None, Some(steering), Some(speed)) => Ok(ChosenWheelOdometry::Halves {
            steering: asked_for(channels, &STEERING, steering)?,
            speed: asked_for(channels, &SPEED, speed)?,
        }),
        (None, None, None) => {
            if let Some(drive) = only_one(channels, &WHEEL_ODOMETRY)? {
                return Ok(ChosenWheelOdometry::Whole(drive));
            }
            let halves = (only_one(channels, &STEERING)?, only_one(channels, &SPEED)?);
            if let (Some(steering), Some(speed)) = halves {
                return Ok(ChosenWheelOdometry::Halves { steering, speed });
            }
            let needed = format!(
                "{}; or {} with the wheels too, or {} of a robot that computes it from its steering, \
                 which {} names; or {} and {} for a topic of each",
                MessageType::AckermannDriveStamped.ros_type(),
                MessageType::JointState.ros_type(),
                MessageType::Odometry.ros_type(),
                WHEEL_ODOMETRY.flag,
                STEERING.flag,
                SPEED.flag
            );
            Err(missing(channels, WHEEL_ODOMETRY.what, needed))
        }
        (drive, steering, speed) => {
            let given = [drive, steering, speed].into_iter().flatten();
            let given: Vec<&str> = given.map(|asked| asked.by).collect();
            let are = if given.len() == 1 { "alone is" } else { "are" };
            Err(TopicError::Halves {
                given: format!("{} {are}", given.join(" and ")),
            })
        }
    }
}

/// Chooses the topic with scans: the requested one, else the only one; clouds in the absence of
/// scans.
///
/// # Errors
/// Reports that there is none, lists the candidates, or names the invalid flag.
pub fn choose_scan_topic(
    channels: &[Channel],
    scan_topic: Option<&str>,
) -> Result<Channel, TopicError> {
    if let Some(topic) = scan_topic {
        let asked = AskedTopic {
            topic: topic.to_owned(),
            by: SCAN.flag,
        };
        return asked_for(channels, &SCAN, &asked);
    }
    only_one(channels, &SCAN)?.ok_or_else(|| missing(channels, SCAN.what, SCAN.needed()))
}

/// Returns the only topic of the most preferred type present; `None` in the absence of any.
fn only_one(channels: &[Channel], wanted: &Wanted) -> Result<Option<Channel>, TopicError> {
    let of_type = |of: &MessageType| -> Vec<&Channel> {
        let fits = |channel: &&Channel| {
            channel.message_type == of.ros_type() && channel.encoding.is_some()
        };
        channels.iter().filter(fits).collect()
    };
    let mut candidates = wanted.found.iter().map(of_type);
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

fn asked_for(
    channels: &[Channel],
    wanted: &Wanted,
    asked: &AskedTopic,
) -> Result<Channel, TopicError> {
    let fits = |channel: &&Channel| {
        let message_type = channel.known_type();
        message_type.is_some_and(|of| wanted.accepted.contains(&of)) && channel.encoding.is_some()
    };
    let of_name = || {
        channels
            .iter()
            .filter(|channel| channel.topic == asked.topic)
    };
    if let Some(channel) = of_name().find(fits) {
        return Ok(channel.clone());
    }
    let flag = asked.by;
    let topic = asked.topic.clone();
    match of_name().next() {
        None => Err(TopicError::NotInRecording {
            flag,
            topic,
            present: present(channels),
        }),
        Some(other) => Err(TopicError::WrongType {
            flag,
            topic,
            found: shown_type(other),
            needed: wanted.needed(),
        }),
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
