//! A recording of a robot as MCAP for Foxglove: its streams, and beside them what was known when and what
//! happened. `fleetcal calibrate --export` writes one of a recording, `GET /robots/{id}/recording` of
//! a robot as it drives.

pub mod live;

use fleetcal_estimator::{Pose2, RobotTime};
use fleetcal_fleet::words;
use fleetcal_proto::RecordingTopic;
use fleetcal_proto::RobotId;
use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::estimate::{ChangeDocument, EstimateDocument};
use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros::{LaserScan, PointCloud2, RosMessage};
use fleetcal_robot::recording::{RecordingError, RobotWriter};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use fleetcal_model::Parameter;

/// Frame of the path, where the robot began.
const ODOM: &str = "odom";
/// The rear axle.
const BASE: &str = "base";
/// Frame of a LiDAR whose messages name none.
const LIDAR: &str = "lidar";

/// A recording that is being written. Everything is logged at its stamp in message time.
#[derive(Debug)]
pub struct RecordingExport<W: Write> {
    writer: RobotWriter<W>,
    /// The LiDAR's frame, once a message has named it.
    lidar_frame: Option<String>,
}

impl RecordingExport<BufWriter<File>> {
    /// Makes the file.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn create(path: &Path, robot: &RobotId) -> Result<Self, RecordingError> {
        Ok(Self::of(RobotWriter::create(path, robot.as_str())?))
    }

    /// Writes the end of the file.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn finish_on_disk(self) -> Result<(), RecordingError> {
        self.writer.finish_on_disk()
    }
}

impl<W: Write> RecordingExport<W> {
    fn of(writer: RobotWriter<W>) -> Self {
        Self {
            writer,
            lidar_frame: None,
        }
    }

    /// Begins to write to `to`, which errors call `path`.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn begin(path: &Path, to: W, robot: &RobotId) -> Result<Self, RecordingError> {
        Ok(Self::of(RobotWriter::begin(path, to, robot.as_str())?))
    }

    /// Adds a message of the robot.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn message(
        &mut self,
        stamp: RobotTime,
        topic: &RecordingTopic,
        payload: &[u8],
    ) -> Result<(), RecordingError> {
        if self.lidar_frame.is_none() {
            self.lidar_frame = frame(topic, payload);
        }
        self.writer.message(stamp.0, topic, payload)
    }

    /// Adds where the rear axle was.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn pose(&mut self, stamp: RobotTime, base_in_odom: &Pose2) -> Result<(), RecordingError> {
        self.writer.transform(stamp.0, ODOM, BASE, *base_in_odom)
    }

    /// Adds what is known now, and where the LiDAR sits by it.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn estimate(&mut self, document: &EstimateDocument) -> Result<(), RecordingError> {
        let stamp_ns = document.stamp_ns;
        let value = |name| document.parameters.get(name).value;
        let lidar_in_base = Pose2 {
            x_m: value(Parameter::LidarX),
            y_m: value(Parameter::LidarY),
            yaw_rad: value(Parameter::LidarYaw),
        };
        let frame = self.lidar_frame.as_deref().unwrap_or(LIDAR);
        self.writer
            .transform(stamp_ns.0, BASE, frame, lidar_in_base)?;
        match serde_json::to_value(document) {
            Ok(document) => self.writer.estimate(stamp_ns.0, &document),
            Err(error) => self.writer.event(
                stamp_ns.0,
                &format!("the estimate cannot be written: {error}"),
            ),
        }
    }

    /// Adds a change or fault.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn change(&mut self, change: &ChangeDocument) -> Result<(), RecordingError> {
        self.event(change.stamp_ns, &words::event(change))
    }

    /// Adds what happened.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn event(&mut self, stamp_ns: RobotTime, words: &str) -> Result<(), RecordingError> {
        self.writer.event(stamp_ns.0, words)
    }

    /// Says how much is missing.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn left_out(&mut self, messages: u64) -> Result<(), RecordingError> {
        self.writer.left_out(messages)
    }

    /// Writes the end.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn finish(self) -> Result<W, RecordingError> {
        self.writer.finish()
    }
}

/// The frame that a scan or cloud names, if it names one.
fn frame(topic: &RecordingTopic, payload: &[u8]) -> Option<String> {
    let named = match (topic.encoding, topic.message_type) {
        (Encoding::Json, MessageType::LaserScan | MessageType::PointCloud2) => {
            let message: serde_json::Value = serde_json::from_slice(payload).ok()?;
            message["header"]["frame_id"].as_str()?.to_owned()
        }
        (Encoding::Cdr, MessageType::LaserScan) => {
            LaserScan::from_cdr(payload).ok()?.header.frame_id
        }
        (Encoding::Cdr, MessageType::PointCloud2) => {
            PointCloud2::from_cdr(payload).ok()?.header.frame_id
        }
        _ => return None,
    };
    Some(named).filter(|frame| !frame.is_empty())
}
