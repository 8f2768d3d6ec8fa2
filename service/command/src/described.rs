//! Description of a recording's robot: of `--urdf`, of the recording, or of a file beside it.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use fleetcal_description::{Description, URDF_BYTES_MAX};
use fleetcal_domain::streams::Joints;
use fleetcal_fleet::static_transform;
use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros::{
    JointState, LaserScan, MultiEchoLaserScan, PointCloud2, RosMessage, StringMessage, TfMessage,
    TransformStamped,
};
use fleetcal_robot::recording::{
    AskedTopic, AskedTopics, Channel, ChosenPose, RecordedMessage, Recording, TopicError, Topics,
};

use crate::CommandError;

/// Last chunk of the topic with a URDF.
const ROBOT_DESCRIPTION: &str = "robot_description";
/// Last chunk of the topic with static transforms.
const TF_STATIC: &str = "tf_static";
/// Name of the description among the reasons for a chosen topic.
const BY: &str = "the joints of robot_description";
/// Most files beside a recording that are looked at.
const BESIDE_MAX: usize = 16;
/// Most messages of a description's topics that are read.
const MESSAGES_MAX: usize = 4_096;
/// First messages of a `JointState` topic that show which joints it has.
const FIRST_MESSAGES: usize = 20;

/// A robot's description, and where it was found.
#[derive(Debug, Default)]
pub struct RecordedDescription {
    /// The description.
    pub description: Description,
    /// Topics and files that it was read from.
    pub origins: Vec<String>,
    /// Faults of what was found and left out.
    pub remarks: Vec<String>,
}

impl RecordedDescription {
    /// Reads the file of `--urdf`, else the recording's own `robot_description`, and its
    /// `tf_static`.
    ///
    /// # Errors
    /// The file cannot be read or is no URDF, or the recording cannot be read.
    pub fn read(
        recording: &Recording,
        urdf: Option<&Path>,
        robot: Option<&str>,
    ) -> Result<Self, CommandError> {
        let mut own = Self::default();
        if let Some(path) = urdf {
            let text = text_of(path)?;
            let described = own.description.set_urdf(&text);
            described.map_err(|refused| CommandError::Description {
                path: path.to_owned(),
                refused,
            })?;
            own.origins.push(path.display().to_string());
        }
        own.take(recording, robot, "")?;
        Ok(own)
    }

    /// Looks for a URDF in the files beside a recording, where it has none: a recording that was
    /// split has it in its first file alone.
    pub fn look_beside(&mut self, recording: &Recording, robot: Option<&str>) {
        if self.description.has_urdf() {
            return;
        }
        let (files, is_split) = recording.files_beside();
        let mut found: Vec<(Self, Recording)> = Vec::new();
        for file in files.iter().take(BESIDE_MAX) {
            match Self::of_file(file, robot) {
                Ok((beside, other)) if beside.description.has_urdf() => {
                    found.push((beside, other));
                    if is_split {
                        break;
                    }
                }
                Ok(_) => {}
                Err(error) => self
                    .remarks
                    .push(format!("a file beside the recording: {error}")),
            }
        }
        let Some((first, file)) = found.first() else {
            return;
        };
        let differs = |other: &&(Self, Recording)| other.0.description != first.description;
        if let Some((_, other)) = found.iter().find(differs) {
            self.remarks.push(format!(
                "{} and {} have different descriptions: none is used, give --urdf",
                file.path().display(),
                other.path().display()
            ));
            return;
        }
        let place = format!(" of {}", file.path().display());
        if let Err(error) = self.take(file, robot, &place) {
            self.remarks
                .push(format!("a file beside the recording: {error}"));
        }
    }

    fn of_file(file: &Path, robot: Option<&str>) -> Result<(Self, Recording), CommandError> {
        let recording = Recording::open(file)?;
        let mut own = Self::default();
        own.take(&recording, robot, "")?;
        Ok((own, recording))
    }

    /// True if nothing was found.
    pub fn is_empty(&self) -> bool {
        self.description.is_empty()
    }

    /// Takes the description of a recording; `place` is named behind its topics.
    fn take(
        &mut self,
        recording: &Recording,
        robot: Option<&str>,
        place: &str,
    ) -> Result<(), CommandError> {
        if !self.description.has_urdf()
            && let Some(channel) =
                self.channel(recording, ROBOT_DESCRIPTION, StringMessage::TYPE, robot)
        {
            for message in messages(recording, channel)? {
                let text = StringMessage::decode(channel.form().encoding, &message?.payload);
                let taken = match text {
                    Ok(text) => self
                        .description
                        .set_urdf(&text.data)
                        .map_err(|of| of.to_string()),
                    Err(refused) => Err(refused.to_string()),
                };
                self.note(channel, place, taken);
            }
        }
        if let Some(channel) = self.channel(recording, TF_STATIC, TfMessage::TYPE, robot) {
            for message in messages(recording, channel)? {
                let decoded = TfMessage::decode(channel.form().encoding, &message?.payload);
                let taken = match decoded {
                    Ok(decoded) => self.take_transforms(decoded.transforms),
                    Err(refused) => Err(refused.to_string()),
                };
                self.note(channel, place, taken);
            }
        }
        Ok(())
    }

    fn take_transforms(&mut self, transforms: Vec<TransformStamped>) -> Result<(), String> {
        for transform in transforms.into_iter().map(static_transform) {
            let added = self.description.add_transform(transform);
            added.map_err(|refused| refused.to_string())?;
        }
        Ok(())
    }

    /// Notes where something was taken from, or why it was not.
    fn note(&mut self, channel: &Channel, place: &str, taken: Result<(), String>) {
        let (list, text) = match taken {
            Ok(()) => (&mut self.origins, format!("{}{place}", channel.topic)),
            Err(refused) => (
                &mut self.remarks,
                format!("{}{place}: {refused}", channel.topic),
            ),
        };
        if !list.contains(&text) {
            list.push(text);
        }
    }

    /// Returns the topic of a recording with this last chunk: the only one, or that of the robot.
    fn channel<'r>(
        &mut self,
        recording: &'r Recording,
        last: &str,
        of_type: &str,
        robot: Option<&str>,
    ) -> Option<&'r Channel> {
        let is_it = |channel: &&Channel| {
            let chunk = channel.topic.rsplit('/').next();
            chunk == Some(last) && channel.message_type == of_type && channel.encoding.is_some()
        };
        let all: Vec<&Channel> = recording.channels().iter().filter(is_it).collect();
        let own = robot.map(|robot| format!("/{robot}/{last}"));
        let top = format!("/{last}");
        let named = |topic: &str| all.iter().find(|channel| channel.topic == topic);
        match all.as_slice() {
            [] => None,
            [only] => Some(only),
            several => {
                let chosen = own.as_deref().and_then(named).or_else(|| named(&top));
                if chosen.is_none() {
                    let topics: Vec<&str> = several.iter().map(|of| of.topic.as_str()).collect();
                    self.remarks.push(format!(
                        "{} topics would be the description: {}; choose a robot with --robot",
                        several.len(),
                        topics.join(", ")
                    ));
                }
                chosen.copied()
            }
        }
    }
}

/// Reads a file with a URDF.
fn text_of(path: &Path) -> Result<String, CommandError> {
    let read = |source| CommandError::Read {
        path: path.to_owned(),
        source,
    };
    let file = File::open(path).map_err(read)?;
    let mut text = String::new();
    let mut limited = file.take(URDF_BYTES_MAX as u64 + 1);
    limited.read_to_string(&mut text).map_err(read)?;
    Ok(text)
}

/// Returns the messages of a topic, and stops reading after the last.
fn messages<'r>(
    recording: &'r Recording,
    channel: &Channel,
) -> Result<impl Iterator<Item = Result<RecordedMessage, CommandError>> + use<'r>, CommandError> {
    let count = usize::try_from(channel.count).unwrap_or(usize::MAX);
    let messages = recording.messages(&[&channel.topic])?;
    let limited = messages.take(count.min(MESSAGES_MAX));
    Ok(limited.map(|message| message.map_err(CommandError::from)))
}

/// Returns the frame of a recording's scans; `None` for poses and for scans without one.
///
/// # Errors
/// The recording cannot be read.
pub fn scan_frame(recording: &Recording, topics: &Topics) -> Result<Option<String>, CommandError> {
    let ChosenPose::Scan(channel) = &topics.pose else {
        return Ok(None);
    };
    let first = messages(recording, channel)?.next().transpose()?;
    let form = channel.form();
    let header = first.and_then(|message| {
        let (encoding, payload) = (form.encoding, &message.payload);
        Some(match form.message_type? {
            MessageType::PointCloud2 => PointCloud2::decode(encoding, payload).ok()?.header,
            MessageType::MultiEchoLaserScan => {
                MultiEchoLaserScan::decode(encoding, payload).ok()?.header
            }
            _ => LaserScan::decode(encoding, payload).ok()?.header,
        })
    });
    let frame = header.map(|header| header.frame_id);
    Ok(frame.filter(|name| !name.is_empty()))
}

/// Requests the topics of wheel odometry that a description's joints are in, where nothing else
/// names them: a `JointState` with both, or with the steering beside an odometry.
///
/// # Errors
/// The recording cannot be read, or several topics have the joints.
pub fn ask_for_joints(
    recording: &Recording,
    joints: &Joints,
    mut asked: AskedTopics,
) -> Result<AskedTopics, CommandError> {
    let channels = recording.channels();
    let of = |message_type: MessageType| {
        let is_it = move |channel: &&Channel| channel.known_type() == Some(message_type);
        channels.iter().filter(is_it).collect::<Vec<&Channel>>()
    };
    let is_asked =
        asked.wheel_odometry.is_some() || asked.steering.is_some() || asked.speed.is_some();
    let measured = [
        MessageType::AckermannDriveStamped,
        MessageType::DriveSamples,
    ]
    .map(of);
    if is_asked || measured.iter().any(|all| !all.is_empty()) {
        return Ok(asked);
    }
    let (mut whole, mut steering) = (Vec::new(), Vec::new());
    for channel in of(MessageType::JointState) {
        let shown = joints_of(recording, channel, joints)?;
        if shown == (true, true) {
            whole.push(channel);
        } else if shown.0 {
            steering.push(channel);
        }
    }
    let request = |channel: &Channel| {
        Some(AskedTopic {
            topic: channel.topic.clone(),
            by: BY,
        })
    };
    let speeds = [MessageType::Odometry, MessageType::TwistStamped].map(of);
    let speed = speeds.iter().find(|all| !all.is_empty()).map(Vec::as_slice);
    match (whole.as_slice(), steering.as_slice(), speed) {
        ([only], _, _) => asked.wheel_odometry = request(only),
        ([], [angle], Some([speed])) => {
            asked.steering = request(angle);
            asked.speed = request(speed);
        }
        ([], ..) => {}
        (several, ..) => {
            let names: Vec<&str> = several.iter().map(|of| of.topic.as_str()).collect();
            return Err(CommandError::Topics(TopicError::Ambiguous {
                what: "wheel odometry",
                count: several.len(),
                candidates: names.join(", "),
                flag: "--wheel-odometry-topic",
            }));
        }
    }
    Ok(asked)
}

/// True for the steering angle, and for the speed, if the first messages of a topic have them.
fn joints_of(
    recording: &Recording,
    channel: &Channel,
    joints: &Joints,
) -> Result<(bool, bool), CommandError> {
    let (mut steers, mut drives) = (false, false);
    for message in messages(recording, channel)?.take(FIRST_MESSAGES) {
        let decoded = JointState::decode(channel.form().encoding, &message?.payload);
        let Ok(state) = decoded else {
            continue;
        };
        let mut steered = joints.steering.iter().chain(&joints.steering_right);
        steers |=
            joints.steering.is_some() && steered.all(|joint| state.position_of(joint).is_some());
        let rolls = |joint: &String| state.velocity_of(joint).is_some();
        drives |= !joints.wheels.is_empty() && joints.wheels.iter().all(rolls);
    }
    Ok((steers, drives))
}
