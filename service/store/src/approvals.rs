//! The life cycle's records as the store keeps them.

use fleetcal_domain::approval::ProposalState;
use fleetcal_model::{AuditId, Version, WallTime};
use fleetcal_proto::RobotId;
use serde::Serialize;

/// Whether deployments are frozen.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct DeploymentFreeze {
    /// Goes up with every change of it.
    pub version: Version,
    /// Whether they are.
    pub frozen: bool,
    /// Who changed it last.
    pub by: Option<String>,
    /// When, ns since 1970, wall time.
    pub at_ns: Option<WallTime>,
    /// Why.
    pub reason: Option<String>,
}

/// Which proposals are asked for.
#[derive(Debug, Clone, Default)]
pub struct ProposalFilter {
    /// Of one robot.
    pub robot: Option<RobotId>,
    /// In one state.
    pub state: Option<ProposalState>,
    /// Below this number.
    pub before: Option<i64>,
    /// At most so many.
    pub limit: u32,
}

/// Which rows of the audit are asked for.
#[derive(Debug, Clone, Default)]
pub struct AuditFilter {
    /// About one robot.
    pub robot: Option<RobotId>,
    /// By one actor.
    pub actor: Option<String>,
    /// Actions that begin so.
    pub action: Option<String>,
    /// From this wall time on, ns.
    pub from_ns: Option<WallTime>,
    /// Before this wall time, ns.
    pub to_ns: Option<WallTime>,
    /// Below this number.
    pub before: Option<i64>,
    /// At most so many.
    pub limit: u32,
}

/// A row of the audit.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct AuditRow {
    /// Its number.
    pub id: AuditId,
    /// When, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// Who.
    pub actor: String,
    /// How that is known.
    pub authentication: String,
    /// What the actor might do.
    pub role: Option<String>,
    /// The HTTP request's id.
    pub request: Option<String>,
    /// The address that it came from.
    pub address: Option<String>,
    /// What was done.
    pub action: String,
    /// To what kind of record.
    pub subject: String,
    /// To which one.
    pub subject_id: String,
    /// The robot it is about.
    pub robot: Option<String>,
    /// The record before.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Object>))]
    pub before: Option<serde_json::Value>,
    /// The record after.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Object>))]
    pub after: Option<serde_json::Value>,
    /// Why.
    pub reason: Option<String>,
}
