//! A simulated fleet on the real wire: robots that stream their sensors over Zenoh in real time,
//! pull the approved calibration, apply it and acknowledge it.
//!
//! The calibration changes how a robot drives, so that what the service estimates and a person
//! approves shows in its cross-track error: a closed loop.

mod calibration;
mod description;
mod message;
mod record;
mod robots;
mod session;
mod task;
#[cfg(test)]
mod tests;

use std::num::NonZeroU32;
use std::sync::Arc;

use fleetcal_model::Generation;
use fleetcal_proto::signing::TrustedKeys;
use fleetcal_proto::{Keys, RobotId};
use thiserror::Error;
use tokio::task::JoinSet;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

pub use crate::session_error::SessionError;
pub use description::urdf;
pub use message::{
    DriveBatch, DriveRefused, StampRefused, drive_message, lidar_pose_message, scan_message,
    truth_message,
};
pub use record::{
    RECORD_DURATION_MAX_S, RecordError, RecordedTruth, RecordedVehicle, TrueSegment, record,
    record_wrong, truth_path,
};
pub use robots::{ROBOTS_MAX, START_STAMP_S, SimulatedRobot, TooManyRobots, simulated_robots};

use crate::agent::TransitionRefused;
use crate::connection::Connection;
use crate::session::ClientConfig;
use crate::simulator::SettingRefused;

/// Options of a simulated fleet.
#[derive(Debug, Clone)]
pub struct FleetOptions {
    /// The robots, from [`simulated_robots`].
    pub robots: Vec<SimulatedRobot>,
    /// Connection to the service; each robot has a session of its own.
    pub connect: Connection,
    /// Keys that they use.
    pub keys: Keys,
    /// Keys whose signatures they trust; with `None` they neither accept nor acknowledge
    /// calibrations.
    pub trusted: Option<TrustedKeys>,
    /// Wall time now, ns since 1970: start of the messages' stamps.
    pub start_stamp_ns: i64,
    /// Seconds that pass for the robots in one of real time, from 1 on.
    pub rate: NonZeroU32,
    /// Messages of their drive samples.
    pub drive_messages: DriveMessages,
}

/// Messages that carry a robot's drive samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DriveMessages {
    /// `fleetcal_msgs/msg/DriveSamples`: those of up to 100 ms in one message.
    #[default]
    Several,
    /// `ackermann_msgs/msg/AckermannDriveStamped`: each in a message of its own.
    Single,
}

/// Summary of one robot's messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RobotSummary {
    /// Id of the robot.
    pub id: RobotId,
    /// Drive samples sent.
    pub drive_samples: u64,
    /// Scans or LiDAR poses sent.
    pub scans: u64,
    /// Messages that were left out because the machine was too slow for real time.
    pub late: u64,
    /// Generation of the calibration it holds; 0 for none.
    pub generation: Generation,
}

/// Reason for which a fleet ended by itself.
#[derive(Debug, Error)]
pub enum FleetError {
    /// A robot's configuration cannot be simulated.
    #[error("robot {robot}: {reason}")]
    Setting {
        /// The robot.
        robot: RobotId,
        /// The setting.
        #[source]
        reason: SettingRefused,
    },
    /// Zenoh refused.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The simulated time left the range of ROS stamps.
    #[error("robot {robot}: {reason}")]
    RobotTime {
        /// The robot.
        robot: RobotId,
        /// The stamp.
        #[source]
        reason: StampRefused,
    },
    /// A drive sample does not fit into a message.
    #[error("robot {robot}: {reason}")]
    Drive {
        /// The robot.
        robot: RobotId,
        /// The field.
        #[source]
        reason: DriveRefused,
    },
    /// A robot's agent reached an impossible state.
    #[error(transparent)]
    Agent(#[from] TransitionRefused),
    /// A robot's task panicked.
    #[error("a robot's task ended: {0}")]
    Task(#[from] tokio::task::JoinError),
}

/// Runs a fleet until `shutdown` is cancelled. A robot that cannot connect keeps trying.
///
/// # Errors
/// An endpoint or a robot's configuration cannot be used. The first robot that fails stops the
/// fleet.
pub async fn run_fleet(
    options: FleetOptions,
    shutdown: CancellationToken,
) -> Result<Vec<RobotSummary>, FleetError> {
    let epoch = task::Epoch {
        instant: Instant::now(),
        stamp_ns: options.start_stamp_ns,
        rate: options.rate,
    };
    let client = Arc::new(ClientConfig::new(&options.connect)?);
    let stop = shutdown.child_token();
    let mut tasks = JoinSet::new();
    for robot in options.robots {
        let (client, keys) = (Arc::clone(&client), options.keys.clone());
        let (trusted, stop) = (options.trusted.clone(), stop.clone());
        let drive_messages = options.drive_messages;
        tasks.spawn(async move {
            let course = task::Course {
                drive_messages,
                epoch,
                stop,
            };
            task::run(robot, &client, &keys, trusted.as_ref(), course).await
        });
    }
    let mut summaries = Vec::new();
    let mut failure = None;
    while let Some(ended) = tasks.join_next().await {
        match ended.map_err(FleetError::from).and_then(|result| result) {
            Ok(summary) => summaries.push(summary),
            Err(error) => {
                stop.cancel();
                failure.get_or_insert(error);
            }
        }
    }
    summaries.sort_by(|a, b| a.id.cmp(&b.id));
    failure.map_or(Ok(summaries), Err)
}
