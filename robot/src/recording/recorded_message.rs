//! One message of a recording.

use std::sync::Arc;

/// One message of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordedMessage {
    /// Log time, ns since 1970.
    pub log_time_ns: u64,
    /// Its topic.
    pub topic: Arc<str>,
    /// Payload, in its channel's encoding.
    pub payload: Vec<u8>,
}
