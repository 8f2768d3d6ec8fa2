//! Robots of a roll-out: what was approved for each, and its stage.

use fleetcal_domain::approval::{Deployment, DeploymentState, ProposalState};
use fleetcal_model::{DeploymentId, ProposalId, RevisionId, RobotId};
use fleetcal_proto::signing::sha256_hex;
use serde::{Deserialize, Serialize};

use crate::plan::WavePlan;

/// Robot of a roll-out, with what was approved for it; it never changes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Member {
    /// The robot.
    pub robot: RobotId,
    /// Number of its wave, from 1.
    pub wave: u32,
    /// Approved proposal.
    pub proposal: ProposalId,
    /// Approved revision. A proposal with another one by now is not what was approved.
    pub revision: RevisionId,
}

/// SHA-256 of the plans of the waves and of their robots, lower-case hexadecimal: who starts a
/// roll-out sends that of the plan which was read.
pub fn plan_sha256<'a>(
    waves: impl IntoIterator<Item = &'a WavePlan>,
    members: &[Member],
) -> String {
    let plan = |wave: &WavePlan| {
        let WavePlan {
            take,
            verified_share,
            failed_share,
        } = wave;
        format!("{take:?} {verified_share} {failed_share}\n")
    };
    let line = |one: &Member| {
        let Member {
            robot,
            wave,
            proposal,
            revision,
        } = one;
        format!("{wave} {robot} {proposal} {revision}\n")
    };
    let plans = waves.into_iter().map(plan);
    let lines: String = plans.chain(members.iter().map(line)).collect();
    sha256_hex(lines.as_bytes())
}

/// Robot of a roll-out, with the present state of its proposal and deployment.
#[derive(Debug, Clone, PartialEq)]
pub struct Followed {
    /// What was approved.
    pub member: Member,
    /// State of the proposal.
    pub proposal_state: ProposalState,
    /// Revision of the proposal by now.
    pub proposal_revision: RevisionId,
    /// Deployment of the proposal, if it was approved.
    pub brought: Option<Brought>,
}

/// Deployment of a proposal, as far as its roll-out needs it.
#[derive(Debug, Clone, PartialEq)]
pub struct Brought {
    /// Number of the deployment.
    pub deployment: DeploymentId,
    /// State of the calibration that it brought, after later returns to earlier values.
    pub state: DeploymentState,
    /// True if a verification estimate disagrees with it.
    pub is_contradicted: bool,
    /// Reason for its state, in words.
    pub reason: Option<String>,
}

impl Brought {
    /// Facts of a deployment, after the returns that people have ordered.
    pub fn of(deployment: &Deployment, returns: &[Deployment]) -> Self {
        let verdict = deployment.verification.as_ref();
        Self {
            deployment: deployment.id,
            state: deployment.state_after(returns),
            is_contradicted: verdict.is_some_and(|verdict| !verdict.within),
            reason: deployment.reason.clone(),
        }
    }
}

/// Stage of a robot in its roll-out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = RolloutStage))]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Its wave has not begun.
    Waiting,
    /// Its wave has begun, and its proposal is not approved by enough people yet.
    Released,
    /// Its calibration is on the way to it, or is being verified.
    Underway,
    /// Verified.
    Verified,
    /// Failed: the robot refused the calibration, could not apply it or went back to the former
    /// one, or a verification estimate disagrees with it.
    Failed,
    /// Left out: its proposal was changed, closed or replaced, or its deployment ended without a
    /// verdict.
    LeftOut,
}

impl Followed {
    /// Stage of the robot; `has_begun` is true once its wave has.
    pub fn stage(&self, has_begun: bool) -> Stage {
        use DeploymentState as D;
        if self.proposal_revision != self.member.revision {
            return Stage::LeftOut;
        }
        let Some(brought) = &self.brought else {
            return match self.proposal_state {
                ProposalState::Proposed if has_begun => Stage::Released,
                ProposalState::Proposed => Stage::Waiting,
                ProposalState::Approved
                | ProposalState::Rejected
                | ProposalState::Expired
                | ProposalState::Withdrawn
                | ProposalState::Superseded => Stage::LeftOut,
            };
        };
        match brought.state {
            D::Verifying if brought.is_contradicted => Stage::Failed,
            D::Queued | D::Offered | D::Applied | D::Verifying => Stage::Underway,
            D::Verified => Stage::Verified,
            D::Refused
            | D::Failed
            | D::RollingBack
            | D::RolledBack
            | D::RollbackFailed
            | D::Kept => Stage::Failed,
            // Nobody knows whether it is right.
            D::Inconclusive | D::TimedOut | D::Withdrawn => Stage::LeftOut,
        }
    }
}

/// Numbers of a wave's robots by stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = RolloutCounts))]
pub struct Counts {
    /// Robots whose wave has not begun.
    pub waiting: u32,
    /// Robots that are not approved by enough people yet.
    pub released: u32,
    /// Robots that receive or verify the calibration.
    pub underway: u32,
    /// Verified robots.
    pub verified: u32,
    /// Robots that have failed.
    pub failed: u32,
    /// Robots left out.
    pub left_out: u32,
}

/// Robots of a wave that will not be verified any more, as a person read them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = RolloutLost))]
#[serde(deny_unknown_fields)]
pub struct Lost {
    /// Robots that have failed.
    pub failed: u32,
    /// Robots left out.
    pub left_out: u32,
}

impl Lost {
    /// Number of the robots.
    pub const fn robots(self) -> u32 {
        self.failed + self.left_out
    }

    /// True if no more robots are lost than these, of each kind.
    pub const fn covers(self, now: Self) -> bool {
        now.failed <= self.failed && now.left_out <= self.left_out
    }
}

impl Counts {
    /// Adds a robot of this stage.
    pub const fn add(&mut self, stage: Stage) {
        *match stage {
            Stage::Waiting => &mut self.waiting,
            Stage::Released => &mut self.released,
            Stage::Underway => &mut self.underway,
            Stage::Verified => &mut self.verified,
            Stage::Failed => &mut self.failed,
            Stage::LeftOut => &mut self.left_out,
        } += 1;
    }

    /// Robots that will not be verified any more.
    pub const fn lost(&self) -> Lost {
        Lost {
            failed: self.failed,
            left_out: self.left_out,
        }
    }

    /// Number of robots that have no outcome yet.
    pub const fn open(&self) -> u32 {
        self.waiting + self.released + self.underway
    }
}
