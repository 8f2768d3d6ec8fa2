//! Lines of the deciding process, one JSON document each, for the test that started it.

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Said {
    /// The store is open.
    Opened,
    /// This is about to be decided: it may or may not be there after a kill.
    Tries(Effect),
    /// It is committed: it must be there whatever happens now.
    Done(Effect),
    /// It was refused: nothing of it may be there.
    Refused {
        /// Whose records.
        robot: String,
    },
    /// The store is closed.
    Closed,
}

/// What a decision does to one robot's records.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Effect {
    /// Whose records.
    pub robot: String,
    /// The audit's rows, in order.
    pub rows: Vec<Row>,
    /// What is to be sent: kind and generation.
    pub outbox: Vec<(String, u64)>,
    /// What was sent.
    pub sent: Option<(String, u64)>,
}

/// A row of the audit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What was done.
    pub action: String,
    /// To what kind of record.
    pub subject: String,
    /// To which one; a guess before it is done.
    pub subject_id: String,
    /// The record afterwards; a guess before it is done.
    pub after: Value,
}
