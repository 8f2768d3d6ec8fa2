//! Errors of Zenoh that refuse a robot.

use std::path::PathBuf;

use thiserror::Error;

/// Why Zenoh refused.
#[derive(Debug, Error)]
pub enum SessionError {
    /// The native configuration cannot be used.
    #[error("the Zenoh configuration {}: {reason}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What Zenoh says.
        reason: String,
    },
    /// The client's configuration cannot be.
    #[error("{field} is {value}: {reason}")]
    Config {
        /// Zenoh's key.
        field: &'static str,
        /// Its value.
        value: String,
        /// What Zenoh says.
        reason: String,
    },
    /// Something could not be declared or sent.
    #[error("{key}: {reason}")]
    Key {
        /// The key expression.
        key: String,
        /// What Zenoh says.
        reason: String,
    },
    /// The thread that opens a session ended.
    #[error("opening a Zenoh session: {0}")]
    Opening(#[from] tokio::task::JoinError),
}
