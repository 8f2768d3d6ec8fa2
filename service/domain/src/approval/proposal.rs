//! Proposal of a calibration to people.

use fleetcal_model::{Generation, ProposalId, RevisionId, Version, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationValues;
use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr, VariantArray};

use super::second_approver::SecondApprover;

/// Where a proposal stands.
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
    /// It waits for approvers.
    Proposed,
    /// Enough people have agreed: a deployment brings it to the robot.
    Approved,
    /// Somebody said no.
    Rejected,
    /// Nobody decided in time.
    Expired,
    /// Who proposed it took it back.
    Withdrawn,
    /// A newer estimate disagrees.
    Superseded,
}

/// What can happen to a proposal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ProposalEvent {
    /// Somebody agreed, and more people have to.
    ApproveInPart,
    /// Somebody agreed, and that is enough.
    Approve,
    /// Somebody said no.
    Reject,
    /// Its time is over.
    Expire,
    /// It is taken back.
    Withdraw,
    /// A newer estimate disagrees.
    Supersede,
    /// The present estimate takes the place of the one it was made from.
    Refresh,
}

impl ProposalState {
    /// All of them.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in documents and in the database.
    pub fn as_str(self) -> &'static str {
        self.into()
    }

    /// The state of this name.
    pub fn parse(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}

/// Somebody's yes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Approval {
    /// Who.
    pub by: String,
    /// When, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// SHA-256 of the revision that was looked at.
    pub sha256: String,
    /// Why.
    pub reason: Option<String>,
}

/// How a proposal ended without a deployment.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Closing {
    /// Who ended it.
    pub by: String,
    /// When, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// Why.
    pub reason: Option<String>,
}

/// That the present estimate took the place of what was proposed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Refreshed {
    /// When it last was, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// How often it was.
    pub times: u32,
    /// Why it last was.
    pub reason: String,
    /// Whose approvals that has voided.
    pub voided: Vec<String>,
}

/// A revision that awaits approval.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Proposal {
    /// Its number.
    pub id: ProposalId,
    /// For which robot.
    pub robot: RobotId,
    /// Goes up with every change of it.
    pub version: Version,
    /// Where it stands.
    pub state: ProposalState,
    /// What is proposed.
    pub revision: RevisionId,
    /// SHA-256 of the revision; approvals bind to it.
    pub revision_sha256: String,
    /// Who proposed it.
    pub proposed_by: String,
    /// Why.
    pub reason: Option<String>,
    /// When, ns since 1970, wall time.
    pub created_ns: WallTime,
    /// When it ends by itself.
    pub expires_ns: WallTime,
    /// What the robot used when this was proposed; `None` when nobody knew.
    pub base: Option<CalibrationValues>,
    /// The generation of that.
    pub base_generation: Option<Generation>,
    /// Author of the drawing that its size was measured from; absent when it was measured from what was
    /// approved before, or the drawing is the configuration file's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drawn_by: Option<String>,
    /// How many people have to agree.
    pub approvals_needed: u32,
    /// Reason for which more than one has to; absent in what older versions proposed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub second_approver: Option<SecondApprover>,
    /// Who has agreed.
    pub approvals: Vec<Approval>,
    /// How it ended otherwise.
    pub closing: Option<Closing>,
    /// That the present estimate took the place of what was proposed; absent unless it did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refreshed: Option<Refreshed>,
}
