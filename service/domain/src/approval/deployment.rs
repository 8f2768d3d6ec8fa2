//! Bringing a revision to one robot.

use fleetcal_model::{DeploymentId, ProposalId, Version, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationValues;
use serde::{Deserialize, Serialize};

use super::generation::{GenerationRef, InUse};
use super::values::Change;

/// Where a deployment stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum DeploymentState {
    /// Approved, and not yet where a robot could see it.
    Queued,
    /// The robot may take it at any moment.
    Offered,
    /// The robot uses it, and that is stored.
    Applied,
    /// The robot was told so, and drives in verification.
    Verifying,
    /// A verification estimate agrees with what the robot uses.
    Verified,
    /// The robot did not drive enough to tell.
    Inconclusive,
    /// The robot would not use it.
    Refused,
    /// The robot could not use it, or went back by itself.
    Failed,
    /// No robot took it in time.
    TimedOut,
    /// It was taken back before the robot had applied it.
    Withdrawn,
    /// The former values are on their way to the robot.
    RollingBack,
    /// The robot uses the former values again.
    RolledBack,
    /// The robot did not take the former values: somebody has to go there.
    RollbackFailed,
    /// A person rolled the robot back to these values and the verification estimate disagrees: the
    /// robot keeps them until people decide otherwise.
    Kept,
}

/// What can happen to a deployment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DeploymentEvent {
    /// It is about to be shown to the robot.
    Offer,
    /// The robot says that it uses what is offered.
    Applied,
    /// The robot will not use what is offered.
    Refused,
    /// The robot could not use what is offered.
    Failed,
    /// The robot went back by itself.
    Reverted,
    /// The robot was told that its answer is stored.
    Confirmed,
    /// A verification estimate agrees.
    Verified,
    /// A verification estimate disagrees, and a person decides what follows.
    VerificationFailed,
    /// A verification estimate disagrees with values that a person rolled the robot back to.
    Contradicted,
    /// There was too little motion to tell.
    TooLittleMotion,
    /// Its time is over.
    TimeOut,
    /// The former values shall come back.
    RollBack,
    /// It shall not be applied: the robot goes on with what it uses.
    Withdraw,
}

impl DeploymentEvent {
    /// All of them.
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
    /// All of them.
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

    /// The state of this name.
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.as_str() == name)
    }

    /// State of what an ended deployment brought, once a person has had it taken back by another one
    /// that stands so. What the robot would not take back stays.
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

    /// Whether it can still change; a robot has at most one of these.
    pub const fn is_live(self) -> bool {
        matches!(
            self,
            Self::Queued | Self::Offered | Self::Applied | Self::Verifying | Self::RollingBack
        )
    }
}

/// Why former values came back to a robot. Kept with the deployment, whatever follows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RollBack {
    /// Who asked for it: a person, or the service.
    pub by: String,
    /// Whether the service did it by itself.
    pub automatic: bool,
    /// When, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// Why.
    pub reason: String,
    /// The values that come back, absolute.
    pub values: CalibrationValues,
}

/// What a verification estimate said of the values in use.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Verification {
    /// When it was judged, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// Distance driven since the values are in use, m.
    pub distance_m: f64,
    /// What is left: verification estimate less values in use; rad, m, m, rad.
    #[cfg_attr(feature = "openapi", schema(value_type = [f64; 4]))]
    pub residual: Change,
    /// Sigmas of the verification estimate, in the same order.
    #[cfg_attr(feature = "openapi", schema(value_type = [f64; 4]))]
    pub sigma: [f64; 4],
    /// Whether the residual with twice its sigma is inside the tolerance.
    pub within: bool,
}

/// A revision on its way to one robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Deployment {
    /// Its number.
    pub id: DeploymentId,
    /// To which robot.
    pub robot: RobotId,
    /// Goes up with every change of it.
    pub version: Version,
    /// Where it stands.
    pub state: DeploymentState,
    /// The proposal that was approved; `None` for a return to an earlier calibration.
    pub proposal: Option<ProposalId>,
    /// Who approved it, or asked for the return.
    pub approved_by: String,
    /// What the robot is to hold now: the approved document, or while it rolls back the one with
    /// the former values.
    pub offer: GenerationRef,
    /// What was offered before it was rolled back.
    pub earlier: Vec<GenerationRef>,
    /// What the robot used before; `None` when nobody knew.
    pub base: Option<InUse>,
    /// What the robot should hold if this comes to nothing.
    pub desired_before: Option<GenerationRef>,
    /// When it was approved, ns since 1970, wall time.
    pub created_ns: WallTime,
    /// When it ends by itself if no robot takes it.
    pub expires_ns: WallTime,
    /// When it was first shown to the robot.
    pub offered_ns: Option<WallTime>,
    /// When the robot's answer was stored.
    pub applied_ns: Option<WallTime>,
    /// When it ended.
    pub closed_ns: Option<WallTime>,
    /// The latest verdict on it.
    pub verification: Option<Verification>,
    /// Why it stands where it stands, in words.
    pub reason: Option<String>,
    /// Who rolled the robot back, why, and to which values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roll_back: Option<RollBack>,
}

impl Deployment {
    /// Whether a person rolled the robot back to it while nothing else was under way: no proposal
    /// stands behind it, and only people end it early.
    pub const fn is_return(&self) -> bool {
        self.proposal.is_none()
    }

    /// State of what it brought to the robot, after the returns to earlier values that people have
    /// asked for since.
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
