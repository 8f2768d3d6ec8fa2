//! Transition of a record. The audit's action, the entry in the robot's history, the live event and
//! the webhook's message follow from it by exhaustive matches, so that a new transition that one of
//! them lacks does not compile.

use strum::{IntoStaticStr, VariantArray};

use super::deployment::Deployment;
use super::proposal::{Proposal, ProposalEvent};
use super::shadow::Shadow;

/// Change of one record: a row of the audit.
#[derive(Debug, Clone, PartialEq)]
pub enum Transition {
    /// Change of a proposal.
    Proposal(Box<Changed<ProposalAction, Proposal>>),
    /// Change of a deployment.
    Deployment(Box<Changed<DeploymentAction, Deployment>>),
    /// Change of the robot's shadow (desired and reported calibration).
    Shadow(Box<Changed<ShadowAction, Shadow>>),
}

/// Record before and after an action.
#[derive(Debug, Clone, PartialEq)]
pub struct Changed<A, R> {
    /// Action on the record.
    pub action: A,
    /// Record before; `None` for a new one.
    pub before: Option<R>,
    /// Record after.
    pub after: R,
    /// Reason, in words.
    pub reason: Option<String>,
}

/// Action on a proposal. The text is the audit's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, IntoStaticStr, VariantArray)]
pub enum ProposalAction {
    /// Proposal by a person or the service.
    #[strum(serialize = "proposal.create")]
    Create,
    /// Approval that is enough.
    #[strum(serialize = "proposal.approve")]
    Approve,
    /// Approval that needs a further one.
    #[strum(serialize = "proposal.approve_in_part")]
    ApproveInPart,
    /// Rejection.
    #[strum(serialize = "proposal.reject")]
    Reject,
    /// End of its time.
    #[strum(serialize = "proposal.expire")]
    Expire,
    /// Withdrawal.
    #[strum(serialize = "proposal.withdraw")]
    Withdraw,
    /// Disagreement of a newer estimate.
    #[strum(serialize = "proposal.supersede")]
    Supersede,
    /// Replacement of the values by the present estimate.
    #[strum(serialize = "proposal.refresh")]
    Refresh,
}

impl From<ProposalEvent> for ProposalAction {
    fn from(event: ProposalEvent) -> Self {
        match event {
            ProposalEvent::ApproveInPart => Self::ApproveInPart,
            ProposalEvent::Approve => Self::Approve,
            ProposalEvent::Reject => Self::Reject,
            ProposalEvent::Expire => Self::Expire,
            ProposalEvent::Withdraw => Self::Withdraw,
            ProposalEvent::Supersede => Self::Supersede,
            ProposalEvent::Refresh => Self::Refresh,
        }
    }
}

/// Action on a deployment. The text is the audit's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, IntoStaticStr, VariantArray)]
pub enum DeploymentAction {
    /// Creation: a revision is queued for the robot.
    #[strum(serialize = "deployment.create")]
    Create,
    /// Offer: the document is about to be sent to the robot.
    #[strum(serialize = "deployment.offer")]
    Offer,
    /// Application by the robot.
    #[strum(serialize = "deployment.apply")]
    Apply,
    /// Refusal by the robot.
    #[strum(serialize = "deployment.refuse")]
    Refuse,
    /// Failure of the robot to apply it.
    #[strum(serialize = "deployment.fail")]
    Fail,
    /// Reversion of the robot by itself.
    #[strum(serialize = "deployment.revert")]
    Revert,
    /// Confirmation: the robot was informed that its answer is stored.
    #[strum(serialize = "deployment.confirm")]
    Confirm,
    /// Agreement of a verification estimate.
    #[strum(serialize = "deployment.verify")]
    Verify,
    /// Disagreement of a verification estimate.
    #[strum(serialize = "deployment.fail_verification")]
    FailVerification,
    /// Disagreement of a verification estimate with values that a person chose; the robot keeps
    /// them.
    #[strum(serialize = "deployment.keep")]
    Keep,
    /// End of the verification without a verdict, after too little motion.
    #[strum(serialize = "deployment.leave_inconclusive")]
    LeaveInconclusive,
    /// End of its time without an answer.
    #[strum(serialize = "deployment.time_out")]
    TimeOut,
    /// Order to return to the former values.
    #[strum(serialize = "deployment.roll_back")]
    RollBack,
}

/// Action on a shadow. The text is the audit's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, IntoStaticStr, VariantArray)]
pub enum ShadowAction {
    /// Change of the desired calibration.
    #[strum(serialize = "shadow.desire")]
    Desire,
    /// Refusal of a revision, which is not proposed again.
    #[strum(serialize = "shadow.decline")]
    Decline,
    /// Answer of the robot.
    #[strum(serialize = "shadow.report")]
    Report,
    /// Verification of a generation.
    #[strum(serialize = "shadow.remember")]
    Remember,
    /// Removal of a verified revision.
    #[strum(serialize = "shadow.forget")]
    Forget,
    /// Begin of maintenance.
    #[strum(serialize = "maintenance.begin")]
    BeginMaintenance,
    /// End of maintenance before its time.
    #[strum(serialize = "maintenance.end")]
    EndMaintenance,
    /// Retirement of the robot.
    #[strum(serialize = "robot.retire")]
    Retire,
    /// Return of a retired robot.
    #[strum(serialize = "robot.bring_back")]
    BringBack,
}

impl Transition {
    /// Number of the record; for a shadow the robot's id.
    pub fn subject_id(&self) -> String {
        match self {
            Self::Proposal(change) => change.after.id.to_string(),
            Self::Deployment(change) => change.after.id.to_string(),
            Self::Shadow(change) => change.after.robot.to_string(),
        }
    }

    /// Reason, in words.
    pub fn reason(&self) -> Option<&str> {
        match self {
            Self::Proposal(change) => change.reason.as_deref(),
            Self::Deployment(change) => change.reason.as_deref(),
            Self::Shadow(change) => change.reason.as_deref(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names<T: VariantArray + Copy + Into<&'static str>>() -> Vec<&'static str> {
        T::VARIANTS.iter().map(|&action| action.into()).collect()
    }

    #[test]
    fn audit_actions_read_as_in_stored_rows() {
        assert_eq!(
            names::<ProposalAction>(),
            [
                "proposal.create",
                "proposal.approve",
                "proposal.approve_in_part",
                "proposal.reject",
                "proposal.expire",
                "proposal.withdraw",
                "proposal.supersede",
                "proposal.refresh",
            ]
        );
        assert_eq!(
            names::<DeploymentAction>(),
            [
                "deployment.create",
                "deployment.offer",
                "deployment.apply",
                "deployment.refuse",
                "deployment.fail",
                "deployment.revert",
                "deployment.confirm",
                "deployment.verify",
                "deployment.fail_verification",
                "deployment.keep",
                "deployment.leave_inconclusive",
                "deployment.time_out",
                "deployment.roll_back",
            ]
        );
        assert_eq!(
            names::<ShadowAction>(),
            [
                "shadow.desire",
                "shadow.decline",
                "shadow.report",
                "shadow.remember",
                "shadow.forget",
                "maintenance.begin",
                "maintenance.end",
                "robot.retire",
                "robot.bring_back",
            ]
        );
    }
}
