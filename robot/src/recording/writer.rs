//! Writes a recording of one robot, as its own recorder would, with the truth beside it.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use fleetcal_proto::RobotId;
use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros::{AckermannDriveStamped, LaserScan, PoseStamped, RosMessage};

use super::RecordingError;
use super::mcap_file::McapFile;

/// Name of the metadata record with a simulated robot's true values.
pub const TRUTH_METADATA: &str = "fleetcal.truth";

/// Writer of `/{robot}/wheel_odometry`, `/{robot}/scan` and `/{robot}/truth` into an MCAP file of
/// profile `ros2`. The same messages give the same bytes.
#[derive(Debug)]
pub struct RecordingWriter {
    file: McapFile<BufWriter<File>>,
    wheel_odometry: u16,
    scan: u16,
    truth: u16,
}

impl RecordingWriter {
    /// Creates the file, or empties it.
    ///
    /// # Errors
    /// When it can't be made.
    pub fn create(path: &Path, robot: &RobotId) -> Result<Self, RecordingError> {
        let mut file = McapFile::create(path)?;
        let mut channel = |stream: &str, of| {
            let topic = format!("/{robot}/{stream}");
            file.stream(&topic, of)
        };
        Ok(Self {
            wheel_odometry: channel("wheel_odometry", MessageType::AckermannDriveStamped)?,
            scan: channel("scan", MessageType::LaserScan)?,
            truth: channel("truth", MessageType::PoseStamped)?,
            file,
        })
    }

    /// Writes a drive sample, logged at its stamp.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn wheel_odometry(
        &mut self,
        message: &AckermannDriveStamped,
    ) -> Result<(), RecordingError> {
        self.wheel_odometry_at(message, message.header.stamp.as_ns())
    }

    /// Writes a drive sample, logged when it arrived, ns.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn wheel_odometry_at(
        &mut self,
        message: &AckermannDriveStamped,
        arrival_ns: i64,
    ) -> Result<(), RecordingError> {
        let times_ns = [arrival_ns, message.header.stamp.as_ns()];
        self.file
            .write(self.wheel_odometry, times_ns, &message.to_cdr())
    }

    /// Writes a scan, which is stamped at its first beam and logged when its last was taken.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn scan(&mut self, message: &LaserScan) -> Result<(), RecordingError> {
        let scan_s = f64::from(message.time_increment) * message.ranges.len() as f64;
        let stamp_ns = message.header.stamp.as_ns();
        self.scan_at(message, stamp_ns.saturating_add((scan_s * 1e9) as i64))
    }

    /// Writes a scan, logged when it arrived, ns.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn scan_at(&mut self, message: &LaserScan, arrival_ns: i64) -> Result<(), RecordingError> {
        let times_ns = [arrival_ns, message.header.stamp.as_ns()];
        self.file.write(self.scan, times_ns, &message.to_cdr())
    }

    /// Writes the true pose of `base` in the world, logged at its stamp.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn truth(&mut self, message: &PoseStamped) -> Result<(), RecordingError> {
        let stamp_ns = message.header.stamp.as_ns();
        self.file
            .write(self.truth, [stamp_ns; 2], &message.to_cdr())
    }

    /// Writes the true values that the estimator is to find, as a metadata record with the name
    /// [`TRUTH_METADATA`].
    ///
    /// # Errors
    /// When it can't be written.
    pub fn true_values(&mut self, values: BTreeMap<String, String>) -> Result<(), RecordingError> {
        self.file.metadata(TRUTH_METADATA, values)
    }

    /// Writes the end of the recording. One without it is refused as truncated.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn finish(self) -> Result<(), RecordingError> {
        self.file.finish_on_disk()
    }
}
