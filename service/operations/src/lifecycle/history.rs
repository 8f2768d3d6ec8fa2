//! Entry of a transition in a robot's history.

use fleetcal_domain::approval::{
    DeploymentAction, DeploymentState, ProposalAction, ShadowAction, Transition,
};
use fleetcal_store::EventKind;

/// Kind of a transition's entry in its robot's history; `None` for one that is in the audit alone.
pub(super) fn kind_of(transition: &Transition) -> Option<EventKind> {
    match transition {
        Transition::Proposal(change) => kind_of_proposal(change.action),
        // A proposal's deployment is told by its approval; one without is a person's roll-back.
        Transition::Deployment(change)
            if change.action == DeploymentAction::Create && change.after.is_return() =>
        {
            Some(EventKind::RollingBack)
        }
        Transition::Deployment(change) => kind_of_deployment(change.action, change.after.state),
        Transition::Shadow(change) => match change.action {
            ShadowAction::Desire
            | ShadowAction::Decline
            | ShadowAction::Report
            | ShadowAction::Remember
            | ShadowAction::Forget
            | ShadowAction::BeginMaintenance
            | ShadowAction::EndMaintenance
            | ShadowAction::Retire
            | ShadowAction::BringBack => None,
        },
    }
}

const fn kind_of_proposal(action: ProposalAction) -> Option<EventKind> {
    match action {
        ProposalAction::Create => Some(EventKind::Proposed),
        ProposalAction::Refresh => Some(EventKind::ProposalRefreshed),
        ProposalAction::ApproveInPart => None,
        ProposalAction::Approve => Some(EventKind::Approved),
        ProposalAction::Reject
        | ProposalAction::Expire
        | ProposalAction::Withdraw
        | ProposalAction::Supersede => Some(EventKind::ProposalClosed),
    }
}

const fn kind_of_deployment(action: DeploymentAction, after: DeploymentState) -> Option<EventKind> {
    match (action, after) {
        (DeploymentAction::Create | DeploymentAction::Confirm, _) => None,
        (DeploymentAction::Offer, _) => Some(EventKind::Offered),
        // Any answer can be the one that ends a roll-back.
        (
            DeploymentAction::Apply
            | DeploymentAction::Refuse
            | DeploymentAction::Fail
            | DeploymentAction::Revert
            | DeploymentAction::TimeOut,
            DeploymentState::RolledBack,
        )
        // No robot had seen it: the former values are in use, and nothing is on its way.
        | (DeploymentAction::RollBack, DeploymentState::Withdrawn) => Some(EventKind::RolledBack),
        (
            DeploymentAction::Apply
            | DeploymentAction::Refuse
            | DeploymentAction::Fail
            | DeploymentAction::Revert
            | DeploymentAction::TimeOut,
            DeploymentState::RollbackFailed,
        ) => Some(EventKind::RollbackFailed),
        (DeploymentAction::Apply, _) => Some(EventKind::Applied),
        (
            DeploymentAction::Refuse
            | DeploymentAction::Fail
            | DeploymentAction::Revert
            | DeploymentAction::TimeOut,
            _,
        ) => Some(EventKind::NotApplied),
        (DeploymentAction::Verify, _) => Some(EventKind::Verified),
        (DeploymentAction::FailVerification | DeploymentAction::Keep, _) => {
            Some(EventKind::VerificationFailed)
        }
        (DeploymentAction::LeaveInconclusive, _) => Some(EventKind::Inconclusive),
        (DeploymentAction::RollBack, _) => Some(EventKind::RollingBack),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_robots_answer_that_ends_a_roll_back_is_told_as_its_end() {
        use DeploymentAction as A;
        use DeploymentState as S;
        for (action, after, kind) in [
            (A::Apply, S::Applied, EventKind::Applied),
            (A::Apply, S::RolledBack, EventKind::RolledBack),
            (A::Refuse, S::Refused, EventKind::NotApplied),
            (A::Refuse, S::RollbackFailed, EventKind::RollbackFailed),
            (A::Fail, S::Failed, EventKind::NotApplied),
            (A::Revert, S::RollbackFailed, EventKind::RollbackFailed),
            (A::TimeOut, S::TimedOut, EventKind::NotApplied),
            (A::TimeOut, S::RollbackFailed, EventKind::RollbackFailed),
            (A::RollBack, S::Withdrawn, EventKind::RolledBack),
            (A::RollBack, S::RollingBack, EventKind::RollingBack),
            (
                A::LeaveInconclusive,
                S::Inconclusive,
                EventKind::Inconclusive,
            ),
            (
                A::FailVerification,
                S::Verifying,
                EventKind::VerificationFailed,
            ),
        ] {
            assert_eq!(kind_of_deployment(action, after), Some(kind), "{action:?}");
        }
        assert_eq!(kind_of_deployment(A::Confirm, S::Verifying), None);
        assert_eq!(kind_of_deployment(A::Create, S::Queued), None);
        let keep = kind_of_deployment(A::Keep, S::Kept);
        assert_eq!(keep, Some(EventKind::VerificationFailed));
    }
}
