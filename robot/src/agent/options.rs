//! Options of an agent, and the errors that end it.

use std::path::PathBuf;

use fleetcal_model::RobotTime;
use fleetcal_proto::signing::TrustedKeys;
use fleetcal_proto::{Keys, RobotId};
use thiserror::Error;

use super::event::TransitionRefused;
use super::file::FileError;
use super::hook::Hook;
use super::limits::Limits;
use super::outputs::Outputs;
use crate::connection::Connection;
use crate::session_error::SessionError;

/// Options of an agent.
#[derive(Debug, Clone)]
pub struct AgentOptions {
    /// Id of the robot.
    pub robot: RobotId,
    /// Connection to the service.
    pub connect: Connection,
    /// The keys under the configured root.
    pub keys: Keys,
    /// File by which values come into use: YAML or JSON by its suffix. The agent's memory is beside
    /// it.
    pub apply: PathBuf,
    /// Additional files, for ROS.
    pub outputs: Outputs,
    /// Keys whose signatures are trusted.
    pub trusted: TrustedKeys,
    /// Limits of the robot.
    pub limits: Limits,
    /// A program that is queried before values are written, and notified when they are written or
    /// withdrawn.
    pub hook: Option<Hook>,
    /// True if the agent holds the robot's liveliness token, which its streams hold otherwise.
    pub holds_alive_token: bool,
    /// The robot's time now, ns since 1970.
    pub start_ns: RobotTime,
}

/// Reason for which an agent ended by itself.
#[derive(Debug, Error)]
pub enum AgentError {
    /// Its file or its memory cannot be used.
    #[error(transparent)]
    File(#[from] FileError),
    /// Zenoh refused.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The agent reached an impossible state.
    #[error(transparent)]
    Transition(#[from] TransitionRefused),
}

impl AgentError {
    /// Returns the command's exit status: 2 for errors that the caller can correct, 70 for a fault
    /// of the agent, 74 for files and the connection.
    pub fn exit_status(&self) -> u8 {
        match self {
            Self::File(FileError::Io { .. } | FileError::Values { .. }) => 74,
            Self::File(_)
            | Self::Session(SessionError::Config { .. } | SessionError::File { .. }) => 2,
            Self::Session(_) => 74,
            Self::Transition(_) => 70,
        }
    }
}
