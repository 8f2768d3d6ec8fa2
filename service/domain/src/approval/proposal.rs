//! Proposal of a calibration to people.

use fleetcal_model::{Generation, ProposalId, RevisionId, Version, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationValues;
use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr, VariantArray};

use super::second_approver::SecondApprover;

/// State of a proposal.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
    EnumString,
    IntoStaticStr,
    VariantArray,
)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum ProposalState {
    /// Open, and awaiting approvers.
    Proposed,
    /// Approved by enough people: a deployment brings it to the robot.
    Approved,
    /// Rejected by a person.
    Rejected,
    /// Expired without a decision.
    Expired,
    /// Withdrawn by its proposer.
    Withdrawn,
    /// Superseded by a newer estimate.
    Superseded,
}

/// Event of a proposal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ProposalEvent {
    /// Approval that needs a further one.
    ApproveInPart,
    /// Approval that is enough.
    Approve,
    /// Rejection.
    Reject,
    /// End of its time.
    Expire,
    /// Withdrawal.
    Withdraw,
    /// Disagreement of a newer estimate.
    Supersede,
    /// Replacement of the values by the present estimate.
    Refresh,
}

impl ProposalState {
    /// Every state.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in documents and in the database.
    pub fn as_str(self) -> &'static str {
        self.into()
    }

    /// Parses the name of a state.
    pub fn parse(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}

/// Approval of a person.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Approval {
    /// Person who approved.
    pub by: String,
    /// Time of the approval, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// SHA-256 of the approved revision.
    pub sha256: String,
    /// Reason given with it.
    pub reason: Option<String>,
}

/// Closing of a proposal without a deployment.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Closing {
    /// Person who closed it, or the service.
    pub by: String,
    /// Time of the closing, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// Reason for the closing.
    pub reason: Option<String>,
}

/// Replacement of the proposed values by the present estimate.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Refreshed {
    /// Time of the last replacement, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// Number of replacements.
    pub times: u32,
    /// Reason for the last replacement.
    pub reason: String,
    /// People whose approvals became void.
    pub voided: Vec<String>,
}

/// A revision that awaits approval.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Proposal {
    /// Number of the proposal.
    pub id: ProposalId,
    /// Robot that it is for.
    pub robot: RobotId,
    /// Version, incremented with every change.
    pub version: Version,
    /// State of the proposal.
    pub state: ProposalState,
    /// Proposed revision.
    pub revision: RevisionId,
    /// SHA-256 of the revision; approvals bind to it.
    pub revision_sha256: String,
    /// Person who proposed it, or the service.
    pub proposed_by: String,
    /// Reason for the proposal.
    pub reason: Option<String>,
    /// Time of the proposal, ns since 1970, wall time.
    pub created_ns: WallTime,
    /// Time at which it expires.
    pub expires_ns: WallTime,
    /// Values in use at the time of the proposal; `None` if unknown.
    pub base: Option<CalibrationValues>,
    /// Generation of the values in use at that time.
    pub base_generation: Option<Generation>,
    /// Author of the drawing that the change is measured from; absent if it is measured from an
    /// approved calibration, or the drawing is the configuration file's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drawn_by: Option<String>,
    /// Number of approvals needed.
    pub approvals_needed: u32,
    /// Reason for which more than one is needed; absent in proposals of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub second_approver: Option<SecondApprover>,
    /// Approvals given.
    pub approvals: Vec<Approval>,
    /// Closing without a deployment, if it was closed.
    pub closing: Option<Closing>,
    /// Replacements of the proposed values by the present estimate; absent before the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refreshed: Option<Refreshed>,
}
