//! Audit rows, as the store keeps them.

use fleetcal_domain::access::Actor;
use fleetcal_domain::audit::Action;
use fleetcal_model::WallTime;
use fleetcal_proto::RobotId;
use serde_json::Value;

/// One change, written in the change's own transaction.
#[derive(Debug, Clone, PartialEq)]
pub struct AuditEntry {
    /// When, wall time.
    pub at_ns: WallTime,
    /// Who.
    pub actor: Actor,
    /// What was done, which says to what kind of record.
    pub action: Action,
    /// To which one.
    pub subject_id: String,
    /// The robot it is about.
    pub robot: Option<RobotId>,
    /// The record before; `None` for a new one.
    pub before: Option<Value>,
    /// The record after; `None` for one that is gone.
    pub after: Option<Value>,
    /// Why, in the actor's words.
    pub reason: Option<String>,
}
