//! In which form a message travels, as its Zenoh encoding says.

use thiserror::Error;

use crate::cdr::CdrError;

/// How much of what a sender wrote is repeated in a refusal, in characters.
const SHOWN_MAX: usize = 160;

/// The form of a ROS 2 message on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Encoding {
    /// CDR, `application/cdr`, and what is taken when the sender says nothing.
    #[default]
    Cdr,
    /// JSON with the same field names, `application/json`.
    Json,
}

impl Encoding {
    /// Reads a Zenoh encoding. What follows a `;` is a schema's name and is left aside; Zenoh's own
    /// `zenoh/bytes` and an empty text mean that the sender said nothing.
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

    /// Its name on the wire.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Cdr => "application/cdr",
            Self::Json => "application/json",
        }
    }
}

/// Why a payload is not the message it should be.
#[derive(Debug, Error)]
pub enum DecodeError {
    /// The sender named an encoding that is not read here.
    #[error("encoding: got {encoding:?}, expected application/cdr and application/json")]
    Encoding {
        /// What the sender named.
        encoding: String,
    },
    /// It is no such message in CDR.
    #[error("{message}: {reason}")]
    Cdr {
        /// The ROS 2 type that was expected.
        message: &'static str,
        /// The field and what is wrong with it.
        #[source]
        reason: CdrError,
    },
    /// It is no such message in JSON.
    #[error("{message}: {field}: {reason}")]
    Json {
        /// The ROS 2 type that was expected.
        message: &'static str,
        /// Path of the field, `drive.speed`; `.` for the whole message.
        field: String,
        /// What is wrong with it.
        reason: String,
    },
}

impl DecodeError {
    /// A refusal of JSON. Both texts may hold what the sender wrote, of any length.
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
