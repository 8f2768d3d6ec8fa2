//! Errors of a recording that cannot be used.

use std::io;
use std::path::PathBuf;

use fleetcal_proto::encoding::DecodeError;
use mcap::McapError;
use thiserror::Error;

/// Reason for which a recording can't be used, in one sentence.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// The file can't be opened, read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        #[source]
        source: io::Error,
    },
    /// The file is empty.
    #[error("{}: the file is empty, expected a recording in MCAP or .db3", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The file is of another kind.
    #[error(
        "{}: this is no MCAP file and no .db3 of rosbag2, expected a recording of ROS 2 messages \
         in either",
        path.display()
    )]
    NoRecording {
        /// The file.
        path: PathBuf,
    },
    /// The file is a bag of ROS 1.
    #[error(
        "{}: this is a bag of ROS 1, expected a recording of ROS 2 messages; `rosbags-convert` of the \
         Python package rosbags converts it: rosbags-convert --src {} --dst FOLDER",
        path.display(),
        path.display()
    )]
    Ros1 {
        /// The file.
        path: PathBuf,
    },
    /// The folder holds no file of messages, or several in an unknown order.
    #[error(
        "{}: the folder holds {count} files of messages (.mcap, .db3, or either with .zstd), expected \
         one, or up to 10000 with the metadata.yaml of rosbag2; or give a file itself",
        path.display()
    )]
    Folder {
        /// The folder.
        path: PathBuf,
        /// Number of its files of messages.
        count: usize,
    },
    /// The metadata of a folder's files are impossible.
    #[error("{}: {reason}", path.display())]
    Metadata {
        /// The file.
        path: PathBuf,
        /// Fault of the metadata.
        reason: String,
    },
    /// The file is packed with zstd and can't be unpacked.
    #[error("{}: the file can't be unpacked: {source}", path.display())]
    Packed {
        /// The file.
        path: PathBuf,
        /// Error of the unpacker.
        #[source]
        source: io::Error,
    },
    /// The file is packed and too large when unpacked.
    #[error("{}: unpacked the recording is larger than 256 GiB", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
    },
    /// The database differs from those of `rosbag2`, or is damaged.
    #[error("{}: the recording is damaged or no .db3 of rosbag2: {reason}", path.display())]
    DamagedBag {
        /// The file.
        path: PathBuf,
        /// Error of SQLite.
        reason: String,
    },
    /// The file ends before the recording does.
    #[error(
        "{}: the recording is truncated: it ends after {readable_s:.3} s and {messages} messages \
         without the end that a finished recording has",
        path.display()
    )]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Seconds of recording that could be read.
        readable_s: f64,
        /// Messages that could be read.
        messages: u64,
    },
    /// A part of the file was altered.
    #[error(
        "{}: the recording is damaged after {readable_s:.3} s and {messages} messages: {source}",
        path.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Seconds of recording that could be read.
        readable_s: f64,
        /// Messages that could be read.
        messages: u64,
        /// Fault of the file.
        #[source]
        source: Box<McapError>,
    },
    /// The file is whole, but contains no messages.
    #[error("{}: the recording has no messages", path.display())]
    NoMessages {
        /// The file.
        path: PathBuf,
    },
    /// The file has more topics than are accepted.
    #[error("{}: the recording has more than {limit} topics", path.display())]
    TooManyChannels {
        /// The file.
        path: PathBuf,
        /// Number of accepted topics.
        limit: usize,
    },
    /// The messages are so far out of order that they can't be sorted on the way.
    #[error(
        "{}: the log times are out of order by {disorder_s:.1} s, which is more than can be held \
         back; sort the recording first",
        path.display()
    )]
    OutOfOrder {
        /// The file.
        path: PathBuf,
        /// Disorder, s.
        disorder_s: f64,
    },
    /// A message in JSON that has no form in CDR.
    #[error("{}: can't write a message of {topic}: {source}", path.display())]
    Message {
        /// The file.
        path: PathBuf,
        /// Topic of the message.
        topic: String,
        /// Fault of the message.
        #[source]
        source: DecodeError,
    },
    /// A message could not be written.
    #[error("{}: can't write the recording: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Error of the writer.
        #[source]
        source: Box<McapError>,
    },
}

impl RecordingError {
    /// Returns the command's exit status: 74 for input and output, 65 for a recording that can't be
    /// used.
    pub fn exit_status(&self) -> u8 {
        match self {
            Self::Io { .. } | Self::Write { .. } => 74,
            _ => 65,
        }
    }
}
