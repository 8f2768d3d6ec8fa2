//! An MCAP that is being written: to a file, or to whoever reads along.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

use fleetcal_proto::message_type::MessageType;
use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, McapError, WriteOptions, Writer};

use super::{RecordingError, definitions};

/// Quality of service that a player of the recording publishes with, as `rosbag2` writes it: the
/// last ten messages, reliable, volatile, without deadlines.
const QOS: &str = "\
- history: 1
  depth: 10
  reliability: 1
  durability: 2
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
";

/// An MCAP file of ROS 2 messages in CDR. The same messages give the same bytes.
pub(super) struct McapFile<W: Write + Seek> {
    /// Path that errors name.
    path: PathBuf,
    writer: Writer<W>,
    sequence: u32,
}

impl<W: Write + Seek> std::fmt::Debug for McapFile<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("McapFile")
            .field("path", &self.path)
            .finish_non_exhaustive()
    }
}

/// Makes the options of every file: ROS 2's profile, in accordance with the content.
pub(super) fn options() -> WriteOptions {
    WriteOptions::new()
        .profile("ros2")
        .compression(Some(Compression::Zstd))
        // One thread: the bytes do not depend on the machine.
        .compression_threads(0)
}

impl McapFile<BufWriter<File>> {
    /// Creates the file, or empties it.
    pub(super) fn create(path: &Path) -> Result<Self, RecordingError> {
        let file = File::create(path).map_err(|source| RecordingError::Io {
            path: path.to_owned(),
            source,
        })?;
        Self::begin(path, BufWriter::new(file), options())
    }

    /// Writes the end and waits until the disk has it all. A file without its end is refused as
    /// truncated.
    pub(super) fn finish_on_disk(self) -> Result<(), RecordingError> {
        let path = self.path.clone();
        sync(&path, self.finish()?)
    }
}

/// Waits until the disk has all written bytes.
pub(super) fn sync(path: &Path, file: BufWriter<File>) -> Result<(), RecordingError> {
    let io = |source| RecordingError::Io {
        path: path.to_owned(),
        source,
    };
    let file = file.into_inner().map_err(|error| io(error.into_error()))?;
    file.sync_all().map_err(io)
}

impl<W: Write + Seek> McapFile<W> {
    /// Writes the beginning to `to`, which errors call `path`.
    pub(super) fn begin(path: &Path, to: W, options: WriteOptions) -> Result<Self, RecordingError> {
        let writer = options.create(to).map_err(|error| refused(path, error))?;
        Ok(Self {
            path: path.to_owned(),
            writer,
            sequence: 0,
        })
    }

    /// Returns the path that errors name.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Adds a channel of a robot's stream.
    pub(super) fn stream(
        &mut self,
        topic: &str,
        message_type: MessageType,
    ) -> Result<u16, RecordingError> {
        let definition = definitions::of(message_type);
        self.channel(topic, message_type.ros_type(), definition)
    }

    /// Adds a channel of ROS 2 messages in CDR.
    pub(super) fn channel(
        &mut self,
        topic: &str,
        ros_type: &str,
        definition: &str,
    ) -> Result<u16, RecordingError> {
        let metadata = [("offered_qos_profiles".to_owned(), QOS.to_owned())];
        let added = self
            .writer
            .add_schema(ros_type, "ros2msg", definition.as_bytes())
            .and_then(|schema| {
                self.writer
                    .add_channel(schema, topic, "cdr", &metadata.into())
            });
        added.map_err(|error| refused(&self.path, error))
    }

    /// Writes a message; times before 1970 become 1970.
    pub(super) fn write(
        &mut self,
        channel_id: u16,
        [log_time_ns, publish_time_ns]: [i64; 2],
        payload: &[u8],
    ) -> Result<(), RecordingError> {
        self.sequence = self.sequence.wrapping_add(1);
        let header = MessageHeader {
            channel_id,
            sequence: self.sequence,
            log_time: log_time_ns.max(0).unsigned_abs(),
            publish_time: publish_time_ns.max(0).unsigned_abs(),
        };
        self.writer
            .write_to_known_channel(&header, payload)
            .map_err(|error| refused(&self.path, error))
    }

    /// Writes a metadata record.
    pub(super) fn metadata(
        &mut self,
        name: &str,
        metadata: BTreeMap<String, String>,
    ) -> Result<(), RecordingError> {
        let record = Metadata {
            name: name.to_owned(),
            metadata,
        };
        self.writer
            .write_metadata(&record)
            .map_err(|error| refused(&self.path, error))
    }

    /// Writes the end and returns the output.
    pub(super) fn finish(mut self) -> Result<W, RecordingError> {
        let finished = self.writer.finish();
        finished.map_err(|error| refused(&self.path, error))?;
        Ok(self.writer.into_inner())
    }
}

fn refused(path: &Path, error: McapError) -> RecordingError {
    let path = path.to_owned();
    match error {
        McapError::Io(source) => RecordingError::Io { path, source },
        error => RecordingError::Write {
            path,
            source: Box::new(error),
        },
    }
}
