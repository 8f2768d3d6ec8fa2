//! Records of the life cycle in the store.

use fleetcal_domain::approval::ProposalState;
use fleetcal_model::{Version, WallTime};
use fleetcal_proto::RobotId;
use serde::Serialize;

/// Deployment freeze: its state and last change.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct DeploymentFreeze {
    /// Version, incremented with every change.
    pub version: Version,
    /// True if deployments are frozen.
    pub frozen: bool,
    /// Person or tool that changed it last.
    pub by: Option<String>,
    /// Time of the change, ns since 1970, wall time.
    pub at_ns: Option<WallTime>,
    /// Reason for the change.
    pub reason: Option<String>,
}

/// Filter of proposals.
#[derive(Debug, Clone, Default)]
pub struct ProposalFilter {
    /// Robot of the proposals.
    pub robot: Option<RobotId>,
    /// State of the proposals.
    pub state: Option<ProposalState>,
    /// Number that the proposals come before.
    pub before: Option<i64>,
    /// Largest number of proposals.
    pub limit: u32,
}

/// Filter of the audit's rows.
#[derive(Debug, Clone, Default)]
pub struct AuditFilter {
    /// Robot of the rows.
    pub robot: Option<RobotId>,
    /// Actor of the rows.
    pub actor: Option<String>,
    /// Prefix of the rows' actions.
    pub action: Option<String>,
    /// Earliest wall time of a row, ns.
    pub from_ns: Option<WallTime>,
    /// Wall time that the rows come before, ns.
    pub to_ns: Option<WallTime>,
    /// Number that the rows come before.
    pub before: Option<i64>,
    /// Largest number of rows.
    pub limit: u32,
}
