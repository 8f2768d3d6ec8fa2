//! Lines of the deciding process, one JSON document each, for the test that started it.

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Line of the deciding process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Said {
    /// The store is open.
    Opened,
    /// A decision is about to be made: it may or may not be stored after a kill.
    Tries(Effect),
    /// A committed decision: it must be stored whatever happens now.
    Done(Effect),
    /// A refused decision: nothing of it may be stored.
    Refused {
        /// The robot.
        robot: String,
    },
    /// The store is closed.
    Closed,
}

/// Effect of a decision on one robot's records.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Effect {
    /// The robot.
    pub robot: String,
    /// The audit's rows, in order.
    pub rows: Vec<Row>,
    /// Outbox messages: kind and generation.
    pub outbox: Vec<(String, u64)>,
    /// Message that was sent.
    pub sent: Option<(String, u64)>,
}

/// A row of the audit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// The action.
    pub action: String,
    /// Kind of the record.
    pub subject: String,
    /// Number of the record; a guess before the decision.
    pub subject_id: String,
    /// The record afterwards; a guess before the decision.
    pub after: Value,
}
