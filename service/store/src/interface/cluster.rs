//! Requests of an instance of a cluster to the store.

use std::sync::Arc;

use async_trait::async_trait;
use fleetcal_domain::approval::RobotLedger;
use fleetcal_model::AuditId;
use fleetcal_proto::RobotId;

use crate::Store;
use crate::audit::AuditRow;
use crate::cluster::{Claims, ClusterRegistry};
use crate::error::StoreError;
use crate::record::CheckpointRecord;
use crate::transaction::{Job, Records};

impl Store {
    /// Registry of the cluster's instances; `None` if a single service has the database.
    pub fn registry(&self) -> Option<Arc<dyn ClusterRegistry>> {
        self.shared.database.registry()
    }

    /// Tenures that telemetry is written under from now on.
    pub fn claims(&self) -> &Claims {
        &self.shared.claims
    }

    /// Sets whether rows are deleted here because of their age, which one instance does for all.
    pub fn set_retention(&self, deletes: bool) {
        self.shared.part.set_deletes(deletes);
    }

    /// Records that this instance has begun to estimate robots: the start is written to their
    /// histories, and rows that another instance has not rolled up are rolled up here.
    pub fn adopted(&self, robots: &[RobotId]) {
        self.shared.part.adopt(robots);
    }

    /// Checkpoints of these robots; robots without one are absent.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn load_checkpoints_of(
        &self,
        robots: &[RobotId],
    ) -> Result<Vec<CheckpointRecord>, StoreError> {
        self.shared.reader.checkpoints_of(robots).await
    }

    /// Reads a robot's records as of one moment; empty ones for a robot without any.
    ///
    /// # Errors
    /// Those of [`Store::transact`].
    pub async fn load_ledger(&self, robot: &RobotId) -> Result<RobotLedger, StoreError> {
        let robot = robot.clone();
        self.transact(LoadLedger { robot }).await
    }

    /// Rows of the audit after number `after`, oldest first, at most `limit`. Their numbers have no
    /// gaps and are in the order of the commits.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn audit_after(
        &self,
        after: AuditId,
        limit: u32,
    ) -> Result<Vec<AuditRow>, StoreError> {
        self.shared.reader.audit_after(after, limit).await
    }

    /// Notes about a robot in the audit after number `after`, oldest first, at most `limit`.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn notes_after(
        &self,
        robot: &RobotId,
        after: AuditId,
        limit: u32,
    ) -> Result<Vec<AuditRow>, StoreError> {
        self.shared.reader.notes_after(robot, after, limit).await
    }

    /// Number of the latest row of the audit; 0 if there is none.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn audit_last(&self) -> Result<AuditId, StoreError> {
        self.shared.reader.audit_last().await
    }
}

/// Reads a robot's records, which are in several tables, as of one moment.
#[derive(Debug)]
struct LoadLedger {
    robot: RobotId,
}

#[async_trait]
impl Job for LoadLedger {
    type Done = RobotLedger;

    async fn run(&self, records: &mut dyn Records) -> Result<RobotLedger, StoreError> {
        records.ledger(&self.robot, None).await
    }
}
