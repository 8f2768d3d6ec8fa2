//! Recordings of robots: ROS 2 messages in MCAP files, or in the SQLite databases of `rosbag2`.
//!
//! [`Recording::open`] reads a file once from end to end, checks every checksum that it has (SQLite's
//! pages have none, so their structure) and counts what is in it. A damaged or truncated file is
//! refused there, before the first message of it went anywhere. [`choose_topics`] finds what to use of it, and [`Recording::messages`] gives the
//! messages in the order in which they were logged.

mod bag;
mod definitions;
mod error;
mod messages;
mod scan;
mod session_writer;
mod storage;
mod topics;
mod writer;

pub use error::RecordingError;
pub use messages::{Messages, RecordedMessage};
pub use session_writer::{PlanarPose, SessionWriter};
pub use topics::{ChosenPose, TopicError, Topics, choose_scan_topic, choose_topics};
pub use writer::{RecordingWriter, TRUTH_METADATA};

use std::path::{Path, PathBuf};

use fleetcal_proto::Encoding;
use fleetcal_proto::encoding::{Form, MessageType};

use storage::{Kind, Storage};

/// Largest record or chunk of a recording. Recorders write chunks of about 1 MiB.
pub const RECORD_BYTES_MAX: usize = 256 << 20;
/// Largest file that one packed with zstd may become, bytes.
pub const UNPACKED_BYTES_MAX: u64 = 256 << 30;
/// Most topics a recording may have.
pub const CHANNELS_MAX: usize = 4096;
/// Most bytes of messages that are held back while they are put in order.
pub const HELD_BYTES_MAX: usize = 512 << 20;

/// One topic of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// The topic, `/tugger_01/drive`.
    pub topic: String,
    /// The ROS 2 type of its messages, `sensor_msgs/msg/LaserScan`; empty when the file has none.
    pub message_type: String,
    /// The form of its messages; `None` when it is one that is not read here.
    pub encoding: Option<Encoding>,
    /// How many messages it has.
    pub count: u64,
}

impl Channel {
    /// How its scans are to be read. A `LaserScan` is what is taken for one anyway.
    pub fn scan_form(&self) -> Form {
        let message_type = MessageType::of_ros_type(&self.message_type);
        Form {
            encoding: self.encoding.unwrap_or_default(),
            message_type: message_type.filter(|&kind| kind == MessageType::PointCloud2),
        }
    }
}

/// A recording that was read through and found whole.
#[derive(Debug, Clone)]
pub struct Recording {
    path: PathBuf,
    storage: Storage,
    channels: Vec<Channel>,
    start_ns: u64,
    end_ns: u64,
    /// How far, at most, a message's log time lies before one that stands earlier in the file.
    disorder_ns: u64,
}

impl Recording {
    /// Reads the file through once. A folder of `rosbag2` with one file of messages stands for that
    /// file; one that is packed with zstd is unpacked first.
    ///
    /// # Errors
    /// When it can't be read, or is no recording, empty, truncated, damaged or without messages.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let storage = Storage::find(path)?;
        let found = match storage.kind {
            Kind::Mcap => scan::read_through(storage.path())?,
            Kind::Sqlite => bag::read_through(storage.path())?,
        };
        Ok(Self {
            path: path.to_owned(),
            storage,
            channels: found.channels,
            start_ns: found.start_ns,
            end_ns: found.end_ns,
            disorder_ns: found.disorder_ns,
        })
    }

    /// The file of messages in it: another one where the recording is a folder, or packed.
    pub fn file(&self) -> &Path {
        self.storage.path()
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its topics, in the order of their names.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// Log time of the first message, ns since 1970.
    pub fn start_ns(&self) -> u64 {
        self.start_ns
    }

    /// Log time of the last message, ns since 1970.
    pub fn end_ns(&self) -> u64 {
        self.end_ns
    }

    /// Time from the first to the last message, s.
    pub fn duration_s(&self) -> f64 {
        self.end_ns.saturating_sub(self.start_ns) as f64 * 1e-9
    }

    /// How many messages some topics have together.
    pub fn count(&self, topics: &[&str]) -> u64 {
        let chosen = |channel: &&Channel| topics.contains(&channel.topic.as_str());
        self.channels
            .iter()
            .filter(chosen)
            .map(|channel| channel.count)
            .sum()
    }

    /// The messages of some topics in the order of their log times; of equal ones, in the order
    /// of the file.
    ///
    /// # Errors
    /// When the file can't be opened any more.
    pub fn messages(&self, topics: &[&str]) -> Result<Messages, RecordingError> {
        Messages::open(&self.storage, topics, self.disorder_ns)
    }
}

/// A ROS type's name as `package/msg/Type`, from any of the spellings in use.
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
