//! Errors that end a replay.

use fleetcal_model::RobotIdRefused;
use fleetcal_proto::RobotId;
use thiserror::Error;

use crate::recording::{RecordingError, TopicError};
use crate::session_error::SessionError;

/// Why a replay was given up, in one sentence.
#[derive(Debug, Error)]
pub enum ReplayError {
    /// The recording can't be used.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// Its topics can't be used.
    #[error(transparent)]
    Topics(#[from] TopicError),
    /// The topics do not say whose they are.
    #[error(
        "wheel odometry topic {topic:?} names no robot in front of the stream; say which with --robot"
    )]
    NoRobot {
        /// The wheel odometry topic.
        topic: String,
    },
    /// The topics name a robot that can't be.
    #[error("wheel odometry topic {topic:?}: {reason}; say which robot with --robot")]
    RobotRefused {
        /// The wheel odometry topic.
        topic: String,
        /// What is wrong with its first chunk.
        #[source]
        reason: RobotIdRefused,
    },
    /// The connection's settings can't be.
    #[error(transparent)]
    Setting(#[from] SessionError),
    /// Nobody answers at the endpoint.
    #[error("no Zenoh router answers at {connection}: {reason}")]
    Connect {
        /// Where it was looked for.
        connection: String,
        /// What Zenoh says.
        reason: String,
    },
    /// Somebody answers, but no service listens to the robot's streams.
    #[error(
        "nobody listens to {key} after {seconds} s: is it the service's router, and does the robot's \
         configuration name the topic?"
    )]
    NobodyListens {
        /// The stream's key.
        key: String,
        /// How long was waited.
        seconds: f64,
    },
    /// Zenoh refused to send or to declare something.
    #[error("{key}: {reason}")]
    Zenoh {
        /// The key.
        key: String,
        /// What Zenoh says.
        reason: String,
    },
    /// The service's answer on its progress is no progress.
    #[error("{key}: the answer is no progress: {reason}")]
    ProgressRefused {
        /// The key.
        key: String,
        /// What is wrong with it.
        #[source]
        reason: serde_json::Error,
    },
    /// The service answers nothing about this robot.
    #[error(
        "the service says nothing of its progress with {robot} for {seconds} s ({sent} messages \
         were sent): does it run, and does it know the robot's vehicle?"
    )]
    NoProgress {
        /// The robot.
        robot: RobotId,
        /// How long.
        seconds: f64,
        /// How many messages were sent.
        sent: u64,
    },
    /// The service stopped working through what it gets.
    #[error(
        "the service has not moved on with {robot} for {seconds} s: {outstanding} of {sent} \
         messages are not worked through"
    )]
    Stalled {
        /// The robot.
        robot: RobotId,
        /// How long.
        seconds: f64,
        /// How many messages were sent.
        sent: u64,
        /// How many of them are missing.
        outstanding: u64,
    },
    /// A thread of the replay ended early.
    #[error("a thread of the replay ended early: {0}")]
    Thread(#[from] tokio::task::JoinError),
}

impl ReplayError {
    /// The command's exit status: 2 for what the caller can mend, 65 for a recording that can't
    /// be used, 74 for the connection.
    pub fn exit_status(&self) -> u8 {
        match self {
            Self::Recording(error) => error.exit_status(),
            Self::Topics(error) => error.exit_status(),
            Self::NoRobot { .. } | Self::RobotRefused { .. } | Self::Setting(_) => 2,
            _ => 74,
        }
    }
}
