//! A topic of a recorded session.

use crate::{Encoding, MessageType};

/// A topic of a session, and what its messages are.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct RecordingTopic {
    /// The topic, `/tugger_01/scan`.
    pub topic: String,
    /// The type of its messages.
    pub message_type: MessageType,
    /// How they are written.
    pub encoding: Encoding,
}
