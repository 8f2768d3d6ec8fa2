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

/// Whose agent it is, and what it works on.
#[derive(Debug, Clone)]
pub struct AgentOptions {
    /// Whose agent it is.
    pub robot: RobotId,
    /// Where the service is.
    pub connect: Connection,
    /// The keys under the configured root.
    pub keys: Keys,
    /// The file to bring values into use by: YAML or JSON by its ending. The agent's memory stands
    /// beside it.
    pub apply: PathBuf,
    /// Files that are written besides, for ROS.
    pub outputs: Outputs,
    /// Whose signatures count.
    pub trusted: TrustedKeys,
    /// What the robot believes.
    pub limits: Limits,
    /// A program that is asked before values are written, and told when they were and when they
    /// went.
    pub hook: Option<Hook>,
    /// Whether to hold the robot's liveliness token, which its streams hold otherwise.
    pub holds_alive_token: bool,
    /// The robot's time now, ns since 1970.
    pub start_ns: RobotTime,
}

/// Why an agent ended before it was told to.
#[derive(Debug, Error)]
pub enum AgentError {
    /// Its file or its memory cannot be used.
    #[error(transparent)]
    File(#[from] FileError),
    /// Zenoh refused.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The agent is at odds with itself.
    #[error(transparent)]
    Transition(#[from] TransitionRefused),
}

impl AgentError {
    /// The command's exit status: 2 for what the caller can mend, 70 for a fault of the agent, 74
    /// for files and the connection.
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
