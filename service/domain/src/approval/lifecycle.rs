//! Transitions of the states of proposals and deployments.

use super::deployment::{DeploymentEvent, DeploymentState};
use super::proposal::{ProposalEvent, ProposalState};
use super::refused::Refused;

impl ProposalState {
    /// State after an event.
    ///
    /// # Errors
    /// [`Refused::ProposalClosed`] for every event once the proposal is decided.
    pub fn after(self, event: ProposalEvent) -> Result<Self, Refused> {
        match (self, event) {
            (Self::Proposed, ProposalEvent::ApproveInPart | ProposalEvent::Refresh) => {
                Ok(Self::Proposed)
            }
            (Self::Proposed, ProposalEvent::Approve) => Ok(Self::Approved),
            (Self::Proposed, ProposalEvent::Reject) => Ok(Self::Rejected),
            (Self::Proposed, ProposalEvent::Expire) => Ok(Self::Expired),
            (Self::Proposed, ProposalEvent::Withdraw) => Ok(Self::Withdrawn),
            (Self::Proposed, ProposalEvent::Supersede) => Ok(Self::Superseded),
            (state, _) => Err(Refused::ProposalClosed { state }),
        }
    }
}

impl DeploymentState {
    /// State after an event.
    ///
    /// # Errors
    /// [`Refused::Deployment`] if the event does not fit the state.
    pub fn after(self, event: DeploymentEvent) -> Result<Self, Refused> {
        use DeploymentEvent as E;
        match (self, event) {
            (Self::Queued, E::Offer) => Ok(Self::Offered),
            (Self::Offered, E::Applied) => Ok(Self::Applied),
            (Self::Offered, E::Refused) => Ok(Self::Refused),
            (Self::Offered | Self::Applied | Self::Verifying, E::Failed | E::Reverted) => {
                Ok(Self::Failed)
            }
            (Self::Applied, E::Confirmed) | (Self::Verifying, E::VerificationFailed) => {
                Ok(Self::Verifying)
            }
            (Self::Verifying, E::Verified) => Ok(Self::Verified),
            (Self::Verifying, E::Contradicted) => Ok(Self::Kept),
            (Self::Verifying, E::TooLittleMotion) => Ok(Self::Inconclusive),
            (Self::Queued | Self::Offered, E::TimeOut) => Ok(Self::TimedOut),
            (Self::Queued | Self::Offered, E::Withdraw) => Ok(Self::Withdrawn),
            (Self::Offered | Self::Applied | Self::Verifying | Self::RollingBack, E::RollBack) => {
                Ok(Self::RollingBack)
            }
            (Self::RollingBack, E::Applied) => Ok(Self::RolledBack),
            (Self::RollingBack, E::Refused | E::Failed | E::Reverted | E::TimeOut) => {
                Ok(Self::RollbackFailed)
            }
            (state, event) => Err(Refused::Deployment { state, event }),
        }
    }
}
