//! Documents of the policy and the deployment freeze.

use fleetcal_domain::approval::Policy;
use fleetcal_model::Version;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

/// Deployment freeze. Its `ETag` is `version`.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = DeploymentFreeze)]
pub struct FreezeDocument {
    /// Version, incremented with every change.
    pub version: Version,
    /// True while no robot is sent a calibration that it does not use yet.
    pub frozen: bool,
    /// Person or tool that changed it last.
    pub by: Option<String>,
    /// Time of the change.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub at: Option<Timestamp>,
    /// Reason for the change.
    pub reason: Option<String>,
}

/// Begin or end of the deployment freeze.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(as = DeploymentFreezeRequest)]
#[serde(deny_unknown_fields)]
pub struct FreezeBody {
    /// True to send no robot a calibration that it does not use yet, false to resume.
    pub frozen: bool,
    /// Reason for the change, 1 to 1000 characters.
    #[schema(min_length = 1, max_length = 1000)]
    pub reason: String,
}

/// Policy in force, and its last change.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = PolicyInForce)]
pub struct PolicyDocument {
    /// Rules in force.
    #[serde(flatten)]
    pub policy: Policy,
    /// Person or tool that set it; absent while `[approval]` in `fleetcal.toml` is in force.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub set_by: Option<String>,
    /// Time of the change.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>, format = DateTime)]
    pub set_at: Option<Timestamp>,
    /// Reason for the change.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub set_reason: Option<String>,
}

/// New policy, with the reason for it.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(as = PolicyRequest)]
#[serde(deny_unknown_fields)]
pub struct PolicyBody {
    /// Whole policy, in which an absent key has its default. Null restores `[approval]` of
    /// `fleetcal.toml`.
    #[serde(deserialize_with = "Option::deserialize")]
    #[schema(required = true)]
    pub policy: Option<Policy>,
    /// Reason for the change, 1 to 1000 characters.
    #[schema(min_length = 1, max_length = 1000)]
    pub reason: String,
}
