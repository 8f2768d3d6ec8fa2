//! Deployment of a revision to one robot.

use fleetcal_model::{DeploymentId, ProposalId, Version, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationValues;
use serde::{Deserialize, Serialize};

use super::generation::{GenerationRef, InUse};
use super::revision::Evidence;
use super::values::Change;

/// State of a deployment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum DeploymentState {
    /// Approved, and not offered to the robot yet.
    Queued,
    /// Offered to the robot, which may apply it at any moment.
    Offered,
    /// Applied by the robot, whose answer is stored.
    Applied,
    /// In verification, after the robot received the confirmation.
    Verifying,
    /// Verified: a verification estimate agrees with the values in use.
    Verified,
    /// Inconclusive: the robot drove too little for a verdict.
    Inconclusive,
    /// Refused by the robot.
    Refused,
    /// Failed at the robot, or reverted by it.
    Failed,
    /// Timed out without a robot's answer.
    TimedOut,
    /// Withdrawn before the robot had applied it.
    Withdrawn,
    /// Rolling back: the former values are offered to the robot.
    RollingBack,
    /// Rolled back: the robot uses the former values again.
    RolledBack,
    /// Roll-back failed: the robot did not apply the former values, and somebody must go to it.
    RollbackFailed,
    /// Kept: a person rolled the robot back to these values, the verification estimate disagrees,
    /// and the robot keeps them until people decide otherwise.
    Kept,
}

/// Event of a deployment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DeploymentEvent {
    /// Offer to the robot is about to be sent.
    Offer,
    /// Robot reports the offered calibration as applied.
    Applied,
    /// Robot refuses the offered calibration.
    Refused,
    /// Robot could not apply the offered calibration.
    Failed,
    /// Robot reverted to its former calibration by itself.
    Reverted,
    /// Confirmation of its answer was sent to the robot.
    Confirmed,
    /// Verification estimate agrees.
    Verified,
    /// Verification estimate disagrees, and a person decides the next step.
    VerificationFailed,
    /// Verification estimate disagrees with values that a person rolled the robot back to.
    Contradicted,
    /// Motion was too little for a verdict.
    TooLittleMotion,
    /// Time of the deployment is over.
    TimeOut,
    /// Roll-back to the former values is ordered.
    RollBack,
    /// Withdrawal is ordered: the robot keeps the calibration in use.
    Withdraw,
}

impl DeploymentEvent {
    /// Every event.
    pub const ALL: [Self; 13] = [
        Self::Offer,
        Self::Applied,
        Self::Refused,
        Self::Failed,
        Self::Reverted,
        Self::Confirmed,
        Self::Verified,
        Self::VerificationFailed,
        Self::Contradicted,
        Self::TooLittleMotion,
        Self::TimeOut,
        Self::RollBack,
        Self::Withdraw,
    ];
}

impl DeploymentState {
    /// Every state.
    pub const ALL: [Self; 14] = [
        Self::Queued,
        Self::Offered,
        Self::Applied,
        Self::Verifying,
        Self::Verified,
        Self::Inconclusive,
        Self::Refused,
        Self::Failed,
        Self::TimedOut,
        Self::Withdrawn,
        Self::RollingBack,
        Self::RolledBack,
        Self::RollbackFailed,
        Self::Kept,
    ];

    /// The name in documents and in the database.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Offered => "offered",
            Self::Applied => "applied",
            Self::Verifying => "verifying",
            Self::Verified => "verified",
            Self::Inconclusive => "inconclusive",
            Self::Refused => "refused",
            Self::Failed => "failed",
            Self::TimedOut => "timed_out",
            Self::Withdrawn => "withdrawn",
            Self::RollingBack => "rolling_back",
            Self::RolledBack => "rolled_back",
            Self::RollbackFailed => "rollback_failed",
            Self::Kept => "kept",
        }
    }

    /// Parses the name of a state.
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.as_str() == name)
    }

    /// State of an ended deployment after a person ordered a return to earlier values that now
    /// stands at `returned`. States that the robot did not return from stay.
    const fn taken_back_by(self, returned: Self) -> Self {
        if !matches!(self, Self::Verified | Self::Inconclusive) {
            return self;
        }
        match returned {
            // A robot that was away still takes what a person chose.
            Self::Queued | Self::Offered | Self::TimedOut => Self::RollingBack,
            Self::Applied | Self::Verifying | Self::Verified | Self::Inconclusive | Self::Kept => {
                Self::RolledBack
            }
            Self::Refused
            | Self::Failed
            | Self::Withdrawn
            | Self::RollingBack
            | Self::RolledBack
            | Self::RollbackFailed => self,
        }
    }

    /// True if it can still change; a robot has at most one such deployment.
    pub const fn is_live(self) -> bool {
        matches!(
            self,
            Self::Queued | Self::Offered | Self::Applied | Self::Verifying | Self::RollingBack
        )
    }
}

/// Roll-back of a robot to former values. Kept with the deployment, whatever follows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RollBack {
    /// Person who ordered it, or the service.
    pub by: String,
    /// True if the service ordered it.
    pub automatic: bool,
    /// Time of the order, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// Reason for the roll-back.
    pub reason: String,
    /// Restored values, absolute.
    pub values: CalibrationValues,
}

/// Verdict of a verification estimate on the values in use.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Verification {
    /// Time of the verdict, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// Distance driven with the values in use, m.
    pub distance_m: f64,
    /// Residual: verification estimate minus values in use; rad, m, m, rad.
    #[cfg_attr(feature = "openapi", schema(value_type = [f64; 4]))]
    pub residual: Change,
    /// Sigmas of the verification estimate, in the same order.
    #[cfg_attr(feature = "openapi", schema(value_type = [f64; 4]))]
    pub sigma: [f64; 4],
    /// True if the residual with twice its sigma is inside the tolerance.
    pub within: bool,
    /// Tolerance that it was judged by, in the same order; absent in verdicts of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<[f64; 4]>))]
    pub limits: Option<Change>,
    /// Evidence of the verification estimate; absent in verdicts of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evidence: Option<Evidence>,
}

/// Deployment of a revision to one robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Deployment {
    /// Number of the deployment.
    pub id: DeploymentId,
    /// Robot that receives it.
    pub robot: RobotId,
    /// Version, incremented with every change.
    pub version: Version,
    /// State of the deployment.
    pub state: DeploymentState,
    /// Approved proposal; `None` for a return to an earlier calibration.
    pub proposal: Option<ProposalId>,
    /// Person who approved it, or ordered the return.
    pub approved_by: String,
    /// Present offer: the approved document, or during a roll-back the one with the former values.
    pub offer: GenerationRef,
    /// Documents offered before the roll-back.
    pub earlier: Vec<GenerationRef>,
    /// Calibration in use before; `None` if unknown.
    pub base: Option<InUse>,
    /// Desired calibration if this deployment fails.
    pub desired_before: Option<GenerationRef>,
    /// Time of the approval, ns since 1970, wall time.
    pub created_ns: WallTime,
    /// Time at which it ends unless the robot applies it.
    pub expires_ns: WallTime,
    /// Time of the first offer to the robot.
    pub offered_ns: Option<WallTime>,
    /// Time at which the robot's answer was stored.
    pub applied_ns: Option<WallTime>,
    /// Time at which it ended.
    pub closed_ns: Option<WallTime>,
    /// Latest verdict of a verification.
    pub verification: Option<Verification>,
    /// Reason for its state, in words.
    pub reason: Option<String>,
    /// Roll-back of the robot: who ordered it, why, and the restored values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roll_back: Option<RollBack>,
}

impl Deployment {
    /// True if a person rolled the robot back to it while nothing else was under way: it has no
    /// proposal, and only people end it early.
    pub const fn is_return(&self) -> bool {
        self.proposal.is_none()
    }

    /// State of the calibration it brought, after the returns to earlier values that people have
    /// ordered since.
    pub fn state_after(&self, returns: &[Self]) -> DeploymentState {
        let leaving = returns.iter().filter(|one| {
            let left = one.base.as_ref().and_then(|base| base.revision);
            one.is_return()
                && one.robot == self.robot
                && one.id > self.id
                && left == Some(self.offer.revision)
        });
        let last = leaving.max_by_key(|one| one.id);
        last.map_or(self.state, |one| self.state.taken_back_by(one.state))
    }
}
