//! Rows of the audit to be written.

use fleetcal_domain::access::Actor;
use fleetcal_domain::audit::Action;
use fleetcal_model::WallTime;
use fleetcal_proto::RobotId;
use serde_json::Value;

/// Row of the audit, written in the transaction of the change itself.
#[derive(Debug, Clone, PartialEq)]
pub struct AuditEntry {
    /// Time of the action, wall time.
    pub at_ns: WallTime,
    /// Actor of the action.
    pub actor: Actor,
    /// Action, which determines the kind of the record.
    pub action: Action,
    /// Number or name of the record.
    pub subject_id: String,
    /// Robot of the record.
    pub robot: Option<RobotId>,
    /// Record before; `None` for a new one.
    pub before: Option<Value>,
    /// Record after; `None` for a removed one.
    pub after: Option<Value>,
    /// Reason, in the actor's words.
    pub reason: Option<String>,
}
