//! A topic of a recorded session.

use crate::{Encoding, MessageType};

/// Topic of a session, with the type of its messages.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct RecordingTopic {
    /// The topic, `/tugger_01/scan`.
    pub topic: String,
    /// The type of its messages.
    pub message_type: MessageType,
    /// Encoding of its messages.
    pub encoding: Encoding,
}
