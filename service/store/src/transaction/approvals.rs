//! The life cycle's records, the deployment freeze, and the policy.

use async_trait::async_trait;
use fleetcal_domain::approval::{NextIds, Outcome, Proposal, RobotLedger};
use fleetcal_model::{Generation, ProposalId, RobotId};

use crate::approvals::DeploymentFreeze;
use crate::error::StoreError;
use crate::policy::StoredPolicy;

/// The life cycle's records; errors as in [`super::Records`].
#[async_trait]
pub trait ApprovalRecords {
    /// One robot's records, with the document of generation `answered`.
    async fn ledger(
        &mut self,
        robot: &RobotId,
        answered: Option<Generation>,
    ) -> Result<RobotLedger, StoreError>;

    /// The numbers that new records get.
    async fn next_ids(&mut self) -> Result<NextIds, StoreError>;

    /// One proposal.
    async fn proposal(&mut self, id: ProposalId) -> Result<Option<Proposal>, StoreError>;

    /// Keeps the records that a step leaves, its documents, and what is to be sent.
    async fn save_outcome(&mut self, outcome: &Outcome) -> Result<(), StoreError>;

    /// The deployment freeze.
    async fn deployment_freeze(&mut self) -> Result<DeploymentFreeze, StoreError>;

    /// Keeps the deployment freeze.
    async fn save_deployment_freeze(&mut self, freeze: &DeploymentFreeze)
    -> Result<(), StoreError>;

    /// The policy that was set.
    async fn stored_policy(&mut self) -> Result<StoredPolicy, StoreError>;

    /// Keeps the policy.
    async fn save_policy(&mut self, policy: &StoredPolicy) -> Result<(), StoreError>;
}
