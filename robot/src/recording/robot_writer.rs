//! Writes a recording of a robot as MCAP of ROS 2: its streams as they were, and beside them what was
//! found of it.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use fleetcal_model::Pose2;
use fleetcal_proto::RecordingTopic;
use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros::{
    Estimate, Header, Log, ParameterEstimate, Quaternion, RosMessage, TfMessage, Time, Transform,
    TransformStamped, Vector3,
};
use mcap::write::NoSeek;

use super::mcap_file::{self, McapFile};
use super::{RecordingError, definitions};

/// Name of the metadata record with the number of missing messages.
pub const RECORDING_METADATA: &str = "fleetcal.session";

/// Writer of a recording: the streams, `/tf` as `tf2_msgs/msg/TFMessage`, `/{robot}/estimate` as
/// `fleetcal_msgs/msg/Estimate` and `/{robot}/events` as `rcl_interfaces/msg/Log`. All are ROS 2
/// messages in CDR with their definitions, so that each reader of ROS recordings reads the file;
/// messages that a robot sent in JSON are converted.
///
/// Everything is logged at its own stamp, by the robot's clock: messages at that of their header, a
/// scan at its first beam; the rest at its message time. A recorder's clock is ignored, since it
/// may be any other. The same messages give the same bytes.
#[derive(Debug)]
pub struct RobotWriter<W: Write> {
    file: McapFile<NoSeek<W>>,
    /// Topic, type and channel of each stream.
    streams: Vec<(String, MessageType, u16)>,
    transforms: u16,
    estimates: u16,
    events: u16,
}

impl RobotWriter<BufWriter<File>> {
    /// Creates the file, or empties it.
    ///
    /// # Errors
    /// When it can't be made.
    pub fn create(path: &Path, robot: &str) -> Result<Self, RecordingError> {
        let file = File::create(path).map_err(|source| RecordingError::Io {
            path: path.to_owned(),
            source,
        })?;
        Self::begin(path, BufWriter::new(file), robot)
    }

    /// Writes the end and waits until the disk has it all. A file without its end is refused as
    /// truncated.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn finish_on_disk(self) -> Result<(), RecordingError> {
        let path = self.file.path().to_owned();
        mcap_file::sync(&path, self.finish()?)
    }
}

impl<W: Write> RobotWriter<W> {
    /// Begins writing to `to`, from beginning to end; errors call it `path`.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn begin(path: &Path, to: W, robot: &str) -> Result<Self, RecordingError> {
        let options = mcap_file::options().disable_seeking(true);
        let mut file = McapFile::begin(path, NoSeek::new(to), options)?;
        let (estimate, events) = (format!("/{robot}/estimate"), format!("/{robot}/events"));
        Ok(Self {
            transforms: file.channel("/tf", TfMessage::TYPE, definitions::TF_MESSAGE)?,
            estimates: file.channel(&estimate, Estimate::TYPE, definitions::ESTIMATE)?,
            events: file.channel(&events, Log::TYPE, definitions::LOG)?,
            streams: Vec::new(),
            file,
        })
    }

    /// Writes a message of the robot, logged at `stamp_ns`.
    ///
    /// # Errors
    /// When it can't be written, or is in JSON and of another type.
    pub fn message(
        &mut self,
        stamp_ns: i64,
        topic: &RecordingTopic,
        payload: &[u8],
    ) -> Result<(), RecordingError> {
        let RecordingTopic {
            topic: name,
            message_type,
            encoding,
        } = topic;
        let converted = message_type.to_cdr(*encoding, payload);
        let payload = converted.map_err(|source| RecordingError::Message {
            path: self.file.path().to_owned(),
            topic: name.clone(),
            source,
        })?;
        let known = self.streams.iter().find(|stream| {
            let (topic, of, _) = stream;
            topic == name && of == message_type
        });
        let channel = if let Some((_, _, known)) = known {
            *known
        } else {
            let added = self.file.stream(name, *message_type)?;
            self.streams.push((name.clone(), *message_type, added));
            added
        };
        self.file.write(channel, [stamp_ns; 2], &payload)
    }

    /// Writes the pose of a frame in another, from `stamp_ns` on.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn transform(
        &mut self,
        stamp_ns: i64,
        parent: &str,
        child: &str,
        child_in_parent: Pose2,
    ) -> Result<(), RecordingError> {
        let Pose2 { x_m, y_m, yaw_rad } = child_in_parent;
        let (z, w) = (0.5 * yaw_rad).sin_cos();
        let transform = Transform {
            translation: Vector3 {
                x: x_m,
                y: y_m,
                z: 0.0,
            },
            rotation: Quaternion {
                x: 0.0,
                y: 0.0,
                z,
                w,
            },
        };
        let transforms = vec![TransformStamped {
            header: header(stamp_ns, parent),
            child_frame_id: child.to_owned(),
            transform,
        }];
        self.write(self.transforms, stamp_ns, &TfMessage { transforms })
    }

    /// Writes the estimate at a time.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn estimate(
        &mut self,
        stamp_ns: i64,
        frame: &str,
        parameters: Vec<ParameterEstimate>,
        document: String,
    ) -> Result<(), RecordingError> {
        let estimate = Estimate {
            header: header(stamp_ns, frame),
            parameters,
            document,
        };
        self.write(self.estimates, stamp_ns, &estimate)
    }

    /// Writes an event, as a warning.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn event(&mut self, stamp_ns: i64, words: &str) -> Result<(), RecordingError> {
        let log = Log {
            stamp: time(stamp_ns),
            level: Log::WARN,
            name: "fleetcal".to_owned(),
            msg: words.to_owned(),
            ..Log::default()
        };
        self.write(self.events, stamp_ns, &log)
    }

    /// Writes the number of messages that are missing because they came faster than they were
    /// written.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn left_out(&mut self, messages: u64) -> Result<(), RecordingError> {
        let values = [("left_out".to_owned(), messages.to_string())];
        self.file.metadata(RECORDING_METADATA, values.into())
    }

    /// Writes the end and returns the output.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn finish(self) -> Result<W, RecordingError> {
        Ok(self.file.finish()?.into_inner())
    }

    fn write(
        &mut self,
        channel: u16,
        stamp_ns: i64,
        message: &impl RosMessage,
    ) -> Result<(), RecordingError> {
        self.file.write(channel, [stamp_ns; 2], &message.to_cdr())
    }
}

/// Returns the ROS stamp of a message time; 1970 outside the years that a ROS stamp can represent.
fn time(stamp_ns: i64) -> Time {
    Time::from_ns(stamp_ns).unwrap_or_default()
}

fn header(stamp_ns: i64, frame: &str) -> Header {
    Header {
        stamp: time(stamp_ns),
        frame_id: frame.to_owned(),
    }
}
