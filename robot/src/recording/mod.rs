//! Recordings of robots: ROS 2 messages in MCAP files, or in the SQLite databases of `rosbag2`.
//!
//! [`Recording::open`] reads a file once from end to end, checks every checksum that it has (SQLite's
//! pages have none, so their structure) and counts what is in it. A damaged or truncated file is
//! refused there, before the first message of it went anywhere. [`choose_topics`] finds what to use of it, and [`Recording::messages`] gives the
//! messages in the order in which they were logged.

mod bag;
mod definitions;
mod error;
mod mcap_file;
mod messages;
mod recorded_message;
mod robot_writer;
mod scan;
mod storage;
mod topics;
mod writer;

pub use error::RecordingError;
pub use messages::Messages;
pub use recorded_message::RecordedMessage;
pub use robot_writer::{RECORDING_METADATA, RobotWriter};
pub use topics::{
    AskedTopic, AskedTopics, ChosenPose, ChosenWheelOdometry, TopicError, Topics,
    choose_scan_topic, choose_topics,
};
pub use writer::{RecordingWriter, TRUTH_METADATA};

use std::path::{Path, PathBuf};

use fleetcal_proto::Encoding;
use fleetcal_proto::message_type::{Form, MessageType};

use scan::{Found, Together};
use storage::{Kind, Storage};

/// Largest record or chunk of a recording. Recorders write chunks of about 1 MiB.
pub const RECORD_BYTES_MAX: usize = 256 << 20;
/// Most files that a split recording may have.
pub const FILES_MAX: usize = 10_000;
/// Largest `metadata.yaml` that is read, bytes.
pub const METADATA_BYTES_MAX: u64 = 16 << 20;
/// Largest unpacked size of a recording packed with zstd, bytes.
pub const UNPACKED_BYTES_MAX: u64 = 256 << 30;
/// Most topics a recording may have.
pub const CHANNELS_MAX: usize = 4096;
/// Most bytes of messages that are held back while they are put in order.
pub const HELD_BYTES_MAX: usize = 512 << 20;

/// One topic of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// The topic, `/tugger_01/wheel_odometry`.
    pub topic: String,
    /// ROS 2 type of its messages, `sensor_msgs/msg/LaserScan`; empty if the file has none.
    pub message_type: String,
    /// Encoding of its messages; `None` for an unknown one.
    pub encoding: Option<Encoding>,
    /// Number of its messages.
    pub count: u64,
}

impl Channel {
    /// Returns the type of its messages, if it is one of [`MessageType`].
    pub fn known_type(&self) -> Option<MessageType> {
        let is_it = |of: &MessageType| of.ros_type() == self.message_type;
        MessageType::ALL.into_iter().find(is_it)
    }

    /// Returns the form of its messages.
    pub fn form(&self) -> Form {
        Form {
            encoding: self.encoding.unwrap_or_default(),
            message_type: self.known_type(),
        }
    }
}

/// A recording that was read through and found whole.
#[derive(Debug, Clone)]
pub struct Recording {
    path: PathBuf,
    /// Its files, in the order in which they were recorded.
    storages: Vec<Storage>,
    found: Found,
}

impl Recording {
    /// Reads the file through once. A folder of `rosbag2` stands for the files of messages in it,
    /// in the order of its `metadata.yaml`; files packed with zstd are unpacked first.
    ///
    /// # Errors
    /// It can't be read, or is not a recording, empty, truncated, damaged or without messages.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let storages = Storage::find(path)?;
        let mut together = Together::default();
        for storage in &storages {
            let found = match storage.kind {
                Kind::Mcap => scan::read_through(storage.path())?,
                Kind::Sqlite => bag::read_through(storage.path())?,
            };
            if !together.add(found) {
                return Err(RecordingError::TooManyChannels {
                    path: path.to_owned(),
                    limit: CHANNELS_MAX,
                });
            }
        }
        let found = together.finish();
        if found.channels.is_empty() {
            return Err(RecordingError::NoMessages {
                path: path.to_owned(),
            });
        }
        Ok(Self {
            path: path.to_owned(),
            storages,
            found,
        })
    }

    /// Returns its files of messages, packed or not, which differ from the path for a folder.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.storages.iter().map(Storage::original)
    }

    /// True if a file belongs to it, so that nothing may be written in its place: it is one of
    /// messages, or is beside one in a folder of `rosbag2` as its `metadata.yaml` or a further
    /// file.
    pub fn holds(&self, file: &Path) -> bool {
        let (Ok(path), Ok(file)) = (self.path.canonicalize(), file.canonicalize()) else {
            return false;
        };
        let is_it = |of: &Path| of.canonicalize().is_ok_and(|of| of == file);
        let folder = if path.is_dir() {
            Some(path.as_path())
        } else {
            path.parent()
        };
        let is_beside = |folder| storage::is_of_bag(folder, &file);
        path == file || self.files().any(is_it) || folder.is_some_and(is_beside)
    }

    /// Returns the other files of messages in the folder of a recording that is one file, in their
    /// order, and whether all are of one split recording. There are none for a folder.
    pub fn files_beside(&self) -> (Vec<PathBuf>, bool) {
        if self.path.is_dir() {
            return (Vec::new(), true);
        }
        storage::files_beside(&self.path)
    }

    /// Returns the path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns its topics, in the order of their names.
    pub fn channels(&self) -> &[Channel] {
        &self.found.channels
    }

    /// Returns the log time of the first message, ns since 1970.
    pub fn start_ns(&self) -> u64 {
        self.found.start_ns
    }

    /// Returns the log time of the last message, ns since 1970.
    pub fn end_ns(&self) -> u64 {
        self.found.end_ns
    }

    /// Returns the time from the first to the last message, s.
    pub fn duration_s(&self) -> f64 {
        self.end_ns().saturating_sub(self.start_ns()) as f64 * 1e-9
    }

    /// Returns the number of messages of some topics together.
    pub fn count(&self, topics: &[&str]) -> u64 {
        let chosen = |channel: &&Channel| topics.contains(&channel.topic.as_str());
        self.channels()
            .iter()
            .filter(chosen)
            .map(|channel| channel.count)
            .sum()
    }

    /// Returns the messages of some topics in the order of their log times; of equal ones, in the
    /// order of the file.
    ///
    /// # Errors
    /// The file can't be opened any more.
    pub fn messages(&self, topics: &[&str]) -> Result<Messages, RecordingError> {
        Messages::open(&self.path, &self.storages, topics, self.found.disorder_ns)
    }
}

/// Normalises a ROS type's name to `package/msg/Type`, from any of the spellings in use.
fn normalised_type(name: &str) -> String {
    let name = name.replace("::dds_::", "::").replace("::", "/");
    let name = name.strip_suffix('_').unwrap_or(&name);
    match name.split_once('/') {
        Some((package, rest)) if !rest.contains('/') => format!("{package}/msg/{rest}"),
        _ => name.to_owned(),
    }
}

#[cfg(test)]
mod tests;
