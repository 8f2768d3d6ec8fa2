//! `calibrate --export`: the session as MCAP, with what was found beside the robot's streams.

use std::path::Path;

use fleetcal_estimator::{Effect, Estimate, Parameter, Pose2, Stamp};
use fleetcal_proto::RobotId;
use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::ros::{LaserScan, PointCloud2, RosMessage};
use fleetcal_robot::recording::{
    Channel, ChosenPose, PlanarPose, RecordedMessage, RecordingError, SessionWriter, Topics,
};

use crate::command::CommandError;
use crate::command::table::event;
use crate::fleet::document::{change_document, estimate_document};

/// Frame of the path, where the robot began.
const ODOM: &str = "odom";
/// The rear axle.
const BASE: &str = "base";
/// Frame of a LiDAR whose messages name none.
const LIDAR: &str = "lidar";

/// A session that is being written.
#[derive(Debug)]
pub struct Export {
    writer: SessionWriter,
    robot: RobotId,
    /// The LiDAR's channel, until a message has named its frame.
    scans: Option<Channel>,
    lidar_frame: String,
}

impl Export {
    /// Makes the file.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn create(path: &Path, robot: &RobotId, topics: &Topics) -> Result<Self, CommandError> {
        let channels = [&topics.drive, topics.pose.channel()];
        let scans = match &topics.pose {
            ChosenPose::Scan(channel) => Some(channel.clone()),
            ChosenPose::LidarOdometry(_) => None,
        };
        Ok(Self {
            writer: SessionWriter::create(path, robot.as_str(), &channels)?,
            robot: robot.clone(),
            scans,
            lidar_frame: LIDAR.to_owned(),
        })
    }

    /// Adds a message of the robot.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn message(&mut self, message: &RecordedMessage) -> Result<(), CommandError> {
        if let Some(channel) = self
            .scans
            .take_if(|channel| *channel.topic == *message.topic)
            && let Some(frame) = frame(&channel, &message.payload)
        {
            self.lidar_frame = frame;
        }
        Ok(self.writer.message(message)?)
    }

    /// Adds where the rear axle was.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn pose(&mut self, stamp: Stamp, base_in_odom: &Pose2) -> Result<(), CommandError> {
        Ok(self
            .writer
            .transform(stamp.0, ODOM, BASE, planar(base_in_odom))?)
    }

    /// Adds what the estimator said.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn effects(&mut self, effects: &[Effect]) -> Result<(), CommandError> {
        for effect in effects {
            match effect {
                Effect::Estimate(estimate) => self.estimate(estimate)?,
                Effect::Change(change) | Effect::ChangeSized(change) => {
                    let words = event(&change_document(change));
                    self.writer.event(change.stamp.0, &words)?;
                }
                Effect::Dropped(_) | Effect::SessionStarted(_) => {}
            }
        }
        Ok(())
    }

    fn estimate(&mut self, estimate: &Estimate) -> Result<(), CommandError> {
        let stamp_ns = estimate.stamp.0;
        let value = |parameter| estimate.parameter(parameter).value;
        let lidar_in_base = PlanarPose {
            x_m: value(Parameter::LidarX),
            y_m: value(Parameter::LidarY),
            yaw_rad: value(Parameter::LidarYaw),
        };
        let frame = &self.lidar_frame;
        self.writer
            .transform(stamp_ns, BASE, frame, lidar_in_base)?;
        let document = serde_json::to_value(estimate_document(&self.robot, estimate))?;
        Ok(self.writer.estimate(stamp_ns, &document)?)
    }

    /// Writes the end of the file.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn finish(self) -> Result<(), RecordingError> {
        self.writer.finish()
    }
}

fn planar(pose: &Pose2) -> PlanarPose {
    PlanarPose {
        x_m: pose.x_m,
        y_m: pose.y_m,
        yaw_rad: pose.yaw_rad,
    }
}

/// The frame that a sweep or cloud names, if it names one.
fn frame(channel: &Channel, payload: &[u8]) -> Option<String> {
    let named = match (channel.encoding?, channel.message_type.as_str()) {
        (Encoding::Json, _) => {
            let message: serde_json::Value = serde_json::from_slice(payload).ok()?;
            message["header"]["frame_id"].as_str()?.to_owned()
        }
        (Encoding::Cdr, LaserScan::TYPE) => LaserScan::from_cdr(payload).ok()?.header.frame_id,
        (Encoding::Cdr, PointCloud2::TYPE) => PointCloud2::from_cdr(payload).ok()?.header.frame_id,
        _ => return None,
    };
    Some(named).filter(|frame| !frame.is_empty())
}
