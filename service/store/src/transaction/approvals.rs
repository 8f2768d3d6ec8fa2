//! Records of the life cycle, the deployment freeze, and the policy.

use async_trait::async_trait;
use fleetcal_domain::approval::{NextIds, Outcome, Proposal, RobotLedger};
use fleetcal_model::{Generation, ProposalId, RobotId};

use crate::approvals::DeploymentFreeze;
use crate::certificates::CertificateRecord;
use crate::error::StoreError;
use crate::policy::StoredPolicy;

/// Records of the life cycle; errors as in [`super::Records`].
#[async_trait]
pub trait ApprovalRecords {
    /// Reads one robot's records, with the document of generation `answered`.
    async fn ledger(
        &mut self,
        robot: &RobotId,
        answered: Option<Generation>,
    ) -> Result<RobotLedger, StoreError>;

    /// Numbers of the next records.
    async fn next_ids(&mut self) -> Result<NextIds, StoreError>;

    /// Reads one proposal.
    async fn proposal(&mut self, id: ProposalId) -> Result<Option<Proposal>, StoreError>;

    /// Stores the outcome of a step: records, documents and messages to send.
    async fn save_outcome(&mut self, outcome: &Outcome) -> Result<(), StoreError>;

    /// Stores the certificate of a deployment.
    async fn save_certificate(&mut self, certificate: &CertificateRecord)
    -> Result<(), StoreError>;

    /// Reads the deployment freeze.
    async fn deployment_freeze(&mut self) -> Result<DeploymentFreeze, StoreError>;

    /// Stores the deployment freeze.
    async fn save_deployment_freeze(&mut self, freeze: &DeploymentFreeze)
    -> Result<(), StoreError>;

    /// Reads the stored policy.
    async fn stored_policy(&mut self) -> Result<StoredPolicy, StoreError>;

    /// Stores the policy.
    async fn save_policy(&mut self, policy: &StoredPolicy) -> Result<(), StoreError>;
}
