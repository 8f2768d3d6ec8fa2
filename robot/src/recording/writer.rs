//! Writes a recording of one robot, as its own recorder would, with the truth beside it.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use fleetcal_proto::RobotId;
use fleetcal_proto::ros::{AckermannDriveStamped, LaserScan, PoseStamped, RosMessage};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, McapError, WriteOptions, Writer};

use super::{RecordingError, definitions};

/// Name of the metadata record that holds a simulated robot's true values.
pub const TRUTH_METADATA: &str = "fleetcal.truth";

/// Writes `/{robot}/drive`, `/{robot}/scan` and `/{robot}/truth` into an MCAP file of profile
/// `ros2`. The same messages give the same bytes.
pub struct RecordingWriter {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    drive: u16,
    scan: u16,
    truth: u16,
    sequence: u32,
}

impl std::fmt::Debug for RecordingWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RecordingWriter")
            .field("path", &self.path)
            .finish_non_exhaustive()
    }
}

impl RecordingWriter {
    /// Makes the file, or empties it.
    ///
    /// # Errors
    /// When it can't be made.
    pub fn create(path: &Path, robot: &RobotId) -> Result<Self, RecordingError> {
        let io = |source| RecordingError::Io {
            path: path.to_owned(),
            source,
        };
        let write = |source: McapError| refused(path, source);
        let file = BufWriter::new(File::create(path).map_err(io)?);
        let options = WriteOptions::new()
            .profile("ros2")
            .compression(Some(Compression::Zstd))
            // One thread: the bytes do not depend on the machine.
            .compression_threads(0);
        let mut writer = options.create(file).map_err(write)?;
        let mut channel = |stream: &str, type_name: &str, definition: &str| {
            let schema = writer.add_schema(type_name, "ros2msg", definition.as_bytes())?;
            writer.add_channel(
                schema,
                &format!("/{robot}/{stream}"),
                "cdr",
                &BTreeMap::new(),
            )
        };
        let drive =
            channel("drive", AckermannDriveStamped::TYPE, definitions::ACKERMANN).map_err(write)?;
        let scan = channel("scan", LaserScan::TYPE, definitions::LASER_SCAN).map_err(write)?;
        let truth =
            channel("truth", PoseStamped::TYPE, definitions::POSE_STAMPED).map_err(write)?;
        Ok(Self {
            path: path.to_owned(),
            writer,
            drive,
            scan,
            truth,
            sequence: 0,
        })
    }

    /// Writes a drive sample, logged at its stamp.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn drive(&mut self, message: &AckermannDriveStamped) -> Result<(), RecordingError> {
        let stamp_ns = message.header.stamp.as_ns();
        self.write(self.drive, stamp_ns, stamp_ns, &message.to_cdr())
    }

    /// Writes a sweep, which is stamped at its first beam and logged when its last was taken.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn scan(&mut self, message: &LaserScan) -> Result<(), RecordingError> {
        let stamp_ns = message.header.stamp.as_ns();
        let sweep_s = f64::from(message.time_increment) * message.ranges.len() as f64;
        let log_time_ns = stamp_ns.saturating_add((sweep_s * 1e9) as i64);
        self.write(self.scan, log_time_ns, stamp_ns, &message.to_cdr())
    }

    /// Writes the true pose of `base` in the world, logged at its stamp.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn truth(&mut self, message: &PoseStamped) -> Result<(), RecordingError> {
        let stamp_ns = message.header.stamp.as_ns();
        self.write(self.truth, stamp_ns, stamp_ns, &message.to_cdr())
    }

    /// Writes the true values that the estimator is to find, as a metadata record with the name
    /// [`TRUTH_METADATA`].
    ///
    /// # Errors
    /// When it can't be written.
    pub fn true_values(&mut self, values: BTreeMap<String, String>) -> Result<(), RecordingError> {
        let metadata = Metadata {
            name: TRUTH_METADATA.to_owned(),
            metadata: values,
        };
        self.writer
            .write_metadata(&metadata)
            .map_err(|source| refused(&self.path, source))
    }

    /// Writes the end of the recording. One without it is refused as truncated.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn finish(mut self) -> Result<(), RecordingError> {
        self.writer
            .finish()
            .map_err(|source| refused(&self.path, source))?;
        let file = self.writer.into_inner().into_inner();
        let io = |source| RecordingError::Io {
            path: self.path.clone(),
            source,
        };
        file.map_err(|error| io(error.into_error()))?
            .sync_all()
            .map_err(io)
    }

    fn write(
        &mut self,
        channel_id: u16,
        log_time_ns: i64,
        stamp_ns: i64,
        payload: &[u8],
    ) -> Result<(), RecordingError> {
        self.sequence = self.sequence.wrapping_add(1);
        // A simulator's stamps are after 1970.
        let header = MessageHeader {
            channel_id,
            sequence: self.sequence,
            log_time: log_time_ns.max(0).unsigned_abs(),
            publish_time: stamp_ns.max(0).unsigned_abs(),
        };
        self.writer
            .write_to_known_channel(&header, payload)
            .map_err(|source| refused(&self.path, source))
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
