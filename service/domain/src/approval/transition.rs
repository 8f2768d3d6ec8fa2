//! Transition of a record. The audit's action, the entry in the robot's history, the live event
//! and the webhook's message follow from it by exhaustive matches, so that a new transition which
//! one of them does not know does not compile.

use strum::{IntoStaticStr, VariantArray};

use super::deployment::Deployment;
use super::proposal::{Proposal, ProposalEvent};
use super::shadow::Shadow;

/// One change of one record: a row of the audit.
#[derive(Debug, Clone, PartialEq)]
pub enum Transition {
    /// Of a proposal.
    Proposal(Box<Changed<ProposalAction, Proposal>>),
    /// Of a deployment.
    Deployment(Box<Changed<DeploymentAction, Deployment>>),
    /// Of what a robot should use and what it reported.
    Shadow(Box<Changed<ShadowAction, Shadow>>),
}

/// A record before and after an action.
#[derive(Debug, Clone, PartialEq)]
pub struct Changed<A, R> {
    /// What was done.
    pub action: A,
    /// The record before; `None` for a new one.
    pub before: Option<R>,
    /// The record after.
    pub after: R,
    /// Why, in words.
    pub reason: Option<String>,
}

/// What is done to a proposal. The text is the audit's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, IntoStaticStr, VariantArray)]
pub enum ProposalAction {
    /// Somebody, or the service, proposes.
    #[strum(serialize = "proposal.create")]
    Create,
    /// Somebody agrees, and that is enough.
    #[strum(serialize = "proposal.approve")]
    Approve,
    /// Somebody agrees, and more people have to.
    #[strum(serialize = "proposal.approve_in_part")]
    ApproveInPart,
    /// Somebody says no.
    #[strum(serialize = "proposal.reject")]
    Reject,
    /// Its time is over.
    #[strum(serialize = "proposal.expire")]
    Expire,
    /// It is taken back.
    #[strum(serialize = "proposal.withdraw")]
    Withdraw,
    /// A newer estimate disagrees.
    #[strum(serialize = "proposal.supersede")]
    Supersede,
    /// The present estimate takes the place of the one it was made from.
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

/// What is done to a deployment. The text is the audit's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, IntoStaticStr, VariantArray)]
pub enum DeploymentAction {
    /// A revision is queued for the robot.
    #[strum(serialize = "deployment.create")]
    Create,
    /// The robot is about to see the document.
    #[strum(serialize = "deployment.offer")]
    Offer,
    /// The robot uses it.
    #[strum(serialize = "deployment.apply")]
    Apply,
    /// The robot will not use it.
    #[strum(serialize = "deployment.refuse")]
    Refuse,
    /// The robot could not use it.
    #[strum(serialize = "deployment.fail")]
    Fail,
    /// The robot went back by itself.
    #[strum(serialize = "deployment.revert")]
    Revert,
    /// The robot knows that its answer is stored.
    #[strum(serialize = "deployment.confirm")]
    Confirm,
    /// A verification estimate agrees.
    #[strum(serialize = "deployment.verify")]
    Verify,
    /// A verification estimate disagrees.
    #[strum(serialize = "deployment.fail_verification")]
    FailVerification,
    /// A verification estimate disagrees with values that a person chose; the robot keeps them.
    #[strum(serialize = "deployment.keep")]
    Keep,
    /// The robot moved too little to tell.
    #[strum(serialize = "deployment.leave_inconclusive")]
    LeaveInconclusive,
    /// Nobody answered in time.
    #[strum(serialize = "deployment.time_out")]
    TimeOut,
    /// The former values shall come back.
    #[strum(serialize = "deployment.roll_back")]
    RollBack,
}

/// What is done to a shadow. The text is the audit's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, IntoStaticStr, VariantArray)]
pub enum ShadowAction {
    /// The robot should hold another document.
    #[strum(serialize = "shadow.desire")]
    Desire,
    /// A revision is not proposed again.
    #[strum(serialize = "shadow.decline")]
    Decline,
    /// The robot has answered.
    #[strum(serialize = "shadow.report")]
    Report,
    /// A generation was verified.
    #[strum(serialize = "shadow.remember")]
    Remember,
    /// A verified revision does not count any more.
    #[strum(serialize = "shadow.forget")]
    Forget,
    /// The robot is switched off on purpose.
    #[strum(serialize = "maintenance.begin")]
    BeginMaintenance,
    /// It is not any more, before its time was over.
    #[strum(serialize = "maintenance.end")]
    EndMaintenance,
}

impl Transition {
    /// The record's number; the robot's id of a shadow.
    pub fn subject_id(&self) -> String {
        match self {
            Self::Proposal(change) => change.after.id.to_string(),
            Self::Deployment(change) => change.after.id.to_string(),
            Self::Shadow(change) => change.after.robot.to_string(),
        }
    }

    /// Why, in words.
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
            ]
        );
    }
}
