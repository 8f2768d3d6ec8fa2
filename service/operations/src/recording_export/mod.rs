//! Recording of a robot as MCAP of ROS 2: its streams, and beside them the estimates and events
//! at their times. `fleetcal calibrate --export` writes one from a recording, and `GET
//! /robots/{id}/recording` one from live data.

pub mod live;

use fleetcal_estimator::{Pose2, RobotTime};
use fleetcal_fleet::{Tapped, words};
use fleetcal_proto::RecordingTopic;
use fleetcal_proto::RobotId;
use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::estimate::{ChangeDocument, EstimateDocument};
use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros::{LaserScan, ParameterEstimate, PointCloud2, RosMessage};
use fleetcal_robot::recording::{RecordingError, RobotWriter};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use fleetcal_model::Parameter;

/// Frame of the path, at the robot's first pose.
const ODOM: &str = "odom";
/// Frame of the rear axle.
const BASE: &str = "base";
/// Frame of a LiDAR whose messages name none.
const LIDAR: &str = "lidar";

/// Recording that is being written. Everything is logged at its stamp in message time.
#[derive(Debug)]
pub struct RecordingExport<W: Write> {
    writer: RobotWriter<W>,
    /// Frame of the LiDAR, once a message has named it.
    lidar_frame: Option<String>,
}

impl RecordingExport<BufWriter<File>> {
    /// Creates the file.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn create(path: &Path, robot: &RobotId) -> Result<Self, RecordingError> {
        Ok(Self::of(RobotWriter::create(path, robot.as_str())?))
    }

    /// Writes the end of the file.
    ///
    /// # Errors
    /// If it cannot be written.
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

    /// Begins to write to `to`; errors name it `path`.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn begin(path: &Path, to: W, robot: &RobotId) -> Result<Self, RecordingError> {
        Ok(Self::of(RobotWriter::begin(path, to, robot.as_str())?))
    }

    /// Adds a message of the robot.
    ///
    /// # Errors
    /// If it cannot be written.
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

    /// Adds a pose of the rear axle.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn pose(&mut self, stamp: RobotTime, base_in_odom: &Pose2) -> Result<(), RecordingError> {
        self.writer.transform(stamp.0, ODOM, BASE, *base_in_odom)
    }

    /// Adds an estimate, and the LiDAR's pose by it.
    ///
    /// # Errors
    /// If it cannot be written.
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
        let parameters = document
            .parameters
            .iter()
            .map(|(name, of)| ParameterEstimate {
                name: name.name().to_owned(),
                value: of.value,
                sigma: of.sigma,
                status: words::word(&of.status),
            });
        match serde_json::to_string(document) {
            Ok(whole) => self
                .writer
                .estimate(stamp_ns.0, BASE, parameters.collect(), whole),
            Err(error) => self.writer.event(
                stamp_ns.0,
                &format!("the estimate cannot be written: {error}"),
            ),
        }
    }

    /// Adds a change or fault.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn change(&mut self, change: &ChangeDocument) -> Result<(), RecordingError> {
        self.event(change.stamp_ns, &words::event(change))
    }

    /// Adds an event.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn event(&mut self, stamp_ns: RobotTime, words: &str) -> Result<(), RecordingError> {
        self.writer.event(stamp_ns.0, words)
    }

    /// Adds an item of a robot's session.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn tapped(&mut self, item: &Tapped) -> Result<(), RecordingError> {
        match item {
            Tapped::Message {
                stamp,
                topic,
                payload,
            } => self.message(*stamp, topic, payload),
            Tapped::Pose(stamp, pose) => self.pose(*stamp, pose),
            Tapped::Estimate(document) => self.estimate(document),
            Tapped::Change(change) => self.change(change),
            Tapped::Event { stamp_ns, words } => self.event(*stamp_ns, words),
        }
    }

    /// Records the number of missing messages.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn left_out(&mut self, messages: u64) -> Result<(), RecordingError> {
        self.writer.left_out(messages)
    }

    /// Writes the end.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(self) -> Result<W, RecordingError> {
        self.writer.finish()
    }
}

/// Frame of a scan or cloud, if the message names one.
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
