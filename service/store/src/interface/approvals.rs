//! Requests for the life cycle's records.

use std::collections::BTreeMap;

use fleetcal_domain::approval::{
    Deployment, DeploymentState, OutboxEntry, Proposal, Revision, RobotLedger,
};
use fleetcal_model::{Generation, ProposalId, RobotId};
use fleetcal_proto::calibration::Envelope;

use crate::Store;
use crate::approvals::{AuditFilter, DeploymentFreeze, ProposalFilter};
use crate::audit::AuditRow;
use crate::error::StoreError;

impl Store {
    /// Records of the life cycle, of every robot that has any.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn load_ledgers(&self) -> Result<Vec<RobotLedger>, StoreError> {
        self.shared.reader.ledgers().await
    }

    /// Reads a signed document.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn envelope(
        &self,
        robot: &RobotId,
        generation: Generation,
    ) -> Result<Option<Envelope>, StoreError> {
        self.shared.reader.envelope(robot, generation).await
    }

    /// Messages to robots that were not sent yet.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn outbox(&self) -> Result<Vec<(RobotId, OutboxEntry)>, StoreError> {
        self.shared.reader.outbox().await
    }

    /// Proposals with their revisions, newest first.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn proposals(
        &self,
        filter: &ProposalFilter,
    ) -> Result<Vec<(Proposal, Revision)>, StoreError> {
        self.shared.reader.proposals(filter).await
    }

    /// Reads a proposal with its revision.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn proposal(
        &self,
        id: ProposalId,
    ) -> Result<Option<(Proposal, Revision)>, StoreError> {
        self.shared.reader.proposal(id).await
    }

    /// Deployments of a robot before number `before`, newest first.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn deployments(
        &self,
        robot: &RobotId,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<Deployment>, StoreError> {
        self.shared.reader.deployments(robot, before, limit).await
    }

    /// State of the calibrations that were approved, by proposal: the deployment's, unless a later
    /// return has undone it.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn followed(
        &self,
        proposals: &[ProposalId],
    ) -> Result<BTreeMap<ProposalId, DeploymentState>, StoreError> {
        self.shared.reader.followed(proposals).await
    }

    /// Reads the deployment freeze.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn deployment_freeze(&self) -> Result<DeploymentFreeze, StoreError> {
        self.shared.reader.deployment_freeze().await
    }

    /// Rows of the audit, newest first.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn audit(&self, filter: &AuditFilter) -> Result<Vec<AuditRow>, StoreError> {
        self.shared.reader.audit(filter).await
    }
}
