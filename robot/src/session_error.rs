//! Errors of Zenoh that refuse a robot.

use std::path::PathBuf;

use thiserror::Error;

/// Error of Zenoh.
#[derive(Debug, Error)]
pub enum SessionError {
    /// The native configuration cannot be used.
    #[error("the Zenoh configuration {}: {reason}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Error of Zenoh.
        reason: String,
    },
    /// The client's configuration is invalid.
    #[error("{field} is {value}: {reason}")]
    Config {
        /// Zenoh's key.
        field: &'static str,
        /// Its value.
        value: String,
        /// Error of Zenoh.
        reason: String,
    },
    /// A declaration or message failed.
    #[error("{key}: {reason}")]
    Key {
        /// The key expression.
        key: String,
        /// Error of Zenoh.
        reason: String,
    },
    /// The thread that opens a session ended.
    #[error("opening a Zenoh session: {0}")]
    Opening(#[from] tokio::task::JoinError),
}
