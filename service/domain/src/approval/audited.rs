//! Audit row of a transition.

use serde::Serialize;
use serde_json::Value;

use super::transition::{Changed, Transition};

/// Record of a transition before and after it, for the audit.
pub fn audited(transition: &Transition) -> (Option<Value>, Value) {
    fn records<A, R: Serialize>(change: &Changed<A, R>) -> (Option<Value>, Value) {
        (change.before.as_ref().map(json), json(&change.after))
    }
    match transition {
        Transition::Proposal(change) => records(change),
        Transition::Deployment(change) => records(change),
        Transition::Shadow(change) => records(change),
    }
}

/// JSON of a record, which holds finite numbers and text only.
fn json<T: Serialize>(record: &T) -> Value {
    serde_json::to_value(record).unwrap_or(Value::Null)
}
