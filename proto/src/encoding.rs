//! Form in which a message travels, by its Zenoh encoding.

use thiserror::Error;

use crate::cdr::CdrError;

/// Longest part of a sender's text that is repeated in a refusal, in characters.
const SHOWN_MAX: usize = 160;

/// The form of a ROS 2 message on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Encoding {
    /// CDR, `application/cdr`, also the default.
    #[default]
    Cdr,
    /// JSON with the same field names, `application/json`.
    Json,
}

impl Encoding {
    /// Parses a Zenoh encoding. A schema's name behind a `;` is ignored; Zenoh's own `zenoh/bytes`
    /// and an empty text mean the default.
    ///
    /// # Errors
    /// Any other encoding, by name.
    pub fn parse(text: &str) -> Result<Self, DecodeError> {
        match text.split(';').next().unwrap_or_default() {
            "" | "zenoh/bytes" | "application/cdr" => Ok(Self::Cdr),
            "application/json" | "text/json" => Ok(Self::Json),
            _ => Err(DecodeError::Encoding {
                encoding: clipped(text),
            }),
        }
    }

    /// Returns its name on the wire.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Cdr => "application/cdr",
            Self::Json => "application/json",
        }
    }
}

/// Reason for which a payload is not the expected message.
#[derive(Debug, Error)]
pub enum DecodeError {
    /// The encoding is unknown.
    #[error("encoding: got {encoding:?}, expected application/cdr and application/json")]
    Encoding {
        /// Encoding that the sender named.
        encoding: String,
    },
    /// The payload is not such a message in CDR.
    #[error("{message}: {reason}")]
    Cdr {
        /// The ROS 2 type that was expected.
        message: &'static str,
        /// The field and its fault.
        #[source]
        reason: CdrError,
    },
    /// The payload is not such a message in JSON.
    #[error("{message}: {field}: {reason}")]
    Json {
        /// The ROS 2 type that was expected.
        message: &'static str,
        /// Path of the field, `drive.speed`; `.` for the whole message.
        field: String,
        /// Fault of the field.
        reason: String,
    },
}

impl DecodeError {
    /// Makes a refusal of JSON. Both texts may contain input of any length.
    pub(crate) fn json(message: &'static str, field: &str, reason: &serde_json::Error) -> Self {
        let field = if field.is_empty() { "." } else { field };
        Self::Json {
            message,
            field: clipped(field),
            reason: clipped(&reason.to_string()),
        }
    }
}

fn clipped(text: &str) -> String {
    match text.char_indices().nth(SHOWN_MAX) {
        None => text.to_owned(),
        Some((end, _)) => format!("{}…", text.get(..end).unwrap_or_default()),
    }
}
