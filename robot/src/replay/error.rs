//! Errors that end a replay.

use fleetcal_model::RobotIdRefused;
use fleetcal_proto::RobotId;
use thiserror::Error;

use crate::recording::{RecordingError, TopicError};
use crate::session_error::SessionError;

/// Reason for which a replay was abandoned, in one sentence.
#[derive(Debug, Error)]
pub enum ReplayError {
    /// The recording can't be used.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// Its topics can't be used.
    #[error(transparent)]
    Topics(#[from] TopicError),
    /// The topics do not identify the robot.
    #[error(
        "wheel odometry topic {topic:?} names no robot in front of the stream; say which with --robot"
    )]
    NoRobot {
        /// The wheel odometry topic.
        topic: String,
    },
    /// The topics name an invalid robot.
    #[error("wheel odometry topic {topic:?}: {reason}; say which robot with --robot")]
    RobotRefused {
        /// The wheel odometry topic.
        topic: String,
        /// Fault of its first chunk.
        #[source]
        reason: RobotIdRefused,
    },
    /// The connection's settings are invalid.
    #[error(transparent)]
    Setting(#[from] SessionError),
    /// The endpoint does not answer.
    #[error("no Zenoh router answers at {connection}: {reason}")]
    Connect {
        /// Endpoint or configuration.
        connection: String,
        /// Error of Zenoh.
        reason: String,
    },
    /// The endpoint answers, but no service subscribes to the robot's streams.
    #[error(
        "nobody listens to {key} after {seconds} s: is it the service's router, and does the robot's \
         configuration name the topic?"
    )]
    NobodyListens {
        /// The stream's key.
        key: String,
        /// Time waited, s.
        seconds: f64,
    },
    /// Zenoh refused a message or a declaration.
    #[error("{key}: {reason}")]
    Zenoh {
        /// The key.
        key: String,
        /// Error of Zenoh.
        reason: String,
    },
    /// The service's answer about its progress is invalid.
    #[error("{key}: the answer is no progress: {reason}")]
    ProgressRefused {
        /// The key.
        key: String,
        /// Fault of the answer.
        #[source]
        reason: serde_json::Error,
    },
    /// The service does not answer about this robot.
    #[error(
        "the service says nothing of its progress with {robot} for {seconds} s ({sent} messages \
         were sent): does it run, and does it know the robot's vehicle?"
    )]
    NoProgress {
        /// The robot.
        robot: RobotId,
        /// Time waited, s.
        seconds: f64,
        /// Number of sent messages.
        sent: u64,
    },
    /// The service stopped processing the messages.
    #[error(
        "the service has not moved on with {robot} for {seconds} s: {outstanding} of {sent} \
         messages are not worked through"
    )]
    Stalled {
        /// The robot.
        robot: RobotId,
        /// Time waited, s.
        seconds: f64,
        /// Number of sent messages.
        sent: u64,
        /// Number of unprocessed ones.
        outstanding: u64,
    },
    /// A thread of the replay ended early.
    #[error("a thread of the replay ended early: {0}")]
    Thread(#[from] tokio::task::JoinError),
}

impl ReplayError {
    /// Returns the command's exit status: 2 for errors that the caller can correct, 65 for a
    /// recording that can't be used, 74 for the connection.
    pub fn exit_status(&self) -> u8 {
        match self {
            Self::Recording(error) => error.exit_status(),
            Self::Topics(error) => error.exit_status(),
            Self::NoRobot { .. } | Self::RobotRefused { .. } | Self::Setting(_) => 2,
            _ => 74,
        }
    }
}
