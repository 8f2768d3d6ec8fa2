//! The life cycle's records: read and written in the transaction of a decision.

use async_trait::async_trait;
use fleetcal_domain::approval::{
    GenerationRef, NextIds, OutboxEntry, Outcome, Proposal, RobotLedger,
};
use fleetcal_model::{DeploymentId, Generation, ProposalId, RevisionId};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Envelope;
use fleetcal_store::transaction::ApprovalRecords;
use fleetcal_store::{CertificateRecord, DeploymentFreeze, StoreError, StoredPolicy};
use serde::Serialize;

use super::certificates;
use super::connection::Connection;
use super::policy;
use super::query::query;
use super::records::{self, LIVE, number, record};
use super::row::{json, parsed};
use super::transaction::SqlRecords;
use super::value::Row;

#[async_trait]
impl ApprovalRecords for SqlRecords<'_> {
    async fn ledger(
        &mut self,
        robot: &RobotId,
        answered: Option<Generation>,
    ) -> Result<RobotLedger, StoreError> {
        ledger(self.connection, robot, answered).await
    }

    async fn next_ids(&mut self) -> Result<NextIds, StoreError> {
        next_ids(self.connection).await
    }

    async fn proposal(&mut self, id: ProposalId) -> Result<Option<Proposal>, StoreError> {
        let row = query("SELECT record FROM proposal WHERE id = $1")
            .bind(i64::try_from(id.0).unwrap_or(i64::MAX))
            .fetch_optional(&mut *self.connection)
            .await
            .map_err(StoreError::database("read a proposal"))?;
        row.map(|row| record(&row, "proposal", 0)).transpose()
    }

    async fn save_outcome(&mut self, outcome: &Outcome) -> Result<(), StoreError> {
        save(self.connection, outcome).await
    }

    async fn save_certificate(
        &mut self,
        certificate: &CertificateRecord,
    ) -> Result<(), StoreError> {
        certificates::save(self.connection, certificate).await
    }

    async fn deployment_freeze(&mut self) -> Result<DeploymentFreeze, StoreError> {
        records::deployment_freeze(&mut *self.connection).await
    }

    async fn save_deployment_freeze(
        &mut self,
        freeze: &DeploymentFreeze,
    ) -> Result<(), StoreError> {
        query("UPDATE site SET version = $1, held = $2, by = $3, at_ns = $4, reason = $5")
            .bind(freeze.version.0 as i64)
            .bind(freeze.frozen)
            .bind(&freeze.by)
            .bind(freeze.at_ns.map(|at| at.0))
            .bind(&freeze.reason)
            .execute(&mut *self.connection)
            .await
            .map_err(StoreError::database("write the deployment freeze"))?;
        Ok(())
    }

    async fn stored_policy(&mut self) -> Result<StoredPolicy, StoreError> {
        policy::read(&mut *self.connection).await
    }

    async fn save_policy(&mut self, policy: &StoredPolicy) -> Result<(), StoreError> {
        policy::save(self.connection, policy).await
    }
}

async fn save(connection: &mut dyn Connection, outcome: &Outcome) -> Result<(), StoreError> {
    let robot = outcome.ledger.shadow.robot.as_str();
    for revision in &outcome.revisions {
        put(
            connection,
            "INSERT INTO revision (id, record) VALUES ($1, $2)",
            revision.id.0,
            revision,
        )
        .await?;
    }
    for proposal in &outcome.proposals {
        let sql = "INSERT INTO proposal (id, record) VALUES ($1, $2)
             ON CONFLICT (id) DO UPDATE SET record = excluded.record";
        put(connection, sql, proposal.id.0, proposal).await?;
    }
    for deployment in &outcome.deployments {
        let sql = "INSERT INTO deployment (id, record) VALUES ($1, $2)
             ON CONFLICT (id) DO UPDATE SET record = excluded.record";
        put(connection, sql, deployment.id.0, deployment).await?;
    }
    if outcome.shadow_changed {
        query(
            "INSERT INTO shadow (robot, record) VALUES ($1, $2)
             ON CONFLICT (robot) DO UPDATE SET record = excluded.record",
        )
        .bind(robot)
        .bind(json("shadow", &outcome.ledger.shadow)?)
        .execute(&mut *connection)
        .await
        .map_err(StoreError::database("write a robot's shadow"))?;
    }
    for (generation, envelope) in &outcome.envelopes {
        query("INSERT INTO envelope (robot, generation, record) VALUES ($1, $2, $3)")
            .bind(robot)
            .bind(generation.0 as i64)
            .bind(json("envelope", envelope)?)
            .execute(&mut *connection)
            .await
            .map_err(StoreError::database("write a signed document"))?;
    }
    write_outbox(connection, robot, outcome).await
}

async fn put<T: Serialize>(
    connection: &mut dyn Connection,
    sql: &'static str,
    id: u64,
    record: &T,
) -> Result<(), StoreError> {
    query(sql)
        .bind(id as i64)
        .bind(json("record", record)?)
        .execute(connection)
        .await
        .map_err(StoreError::database("write a record of the life cycle"))?;
    Ok(())
}

async fn write_outbox(
    connection: &mut dyn Connection,
    robot: &str,
    outcome: &Outcome,
) -> Result<(), StoreError> {
    let failed = || StoreError::database("write the outbox");
    if let Some(sent) = outcome.sent {
        let (kind, generation) = columns_of(sent);
        // A newer one of its kind stays.
        query("DELETE FROM outbox WHERE robot = $1 AND kind = $2 AND generation = $3")
            .bind(robot)
            .bind(kind)
            .bind(generation)
            .execute(&mut *connection)
            .await
            .map_err(failed())?;
    }
    for entry in &outcome.outbox {
        let (kind, generation) = columns_of(*entry);
        query(
            "INSERT INTO outbox (robot, kind, generation) VALUES ($1, $2, $3)
             ON CONFLICT (robot, kind) DO UPDATE SET generation = excluded.generation",
        )
        .bind(robot)
        .bind(kind)
        .bind(generation)
        .execute(&mut *connection)
        .await
        .map_err(failed())?;
    }
    Ok(())
}

const fn columns_of(entry: OutboxEntry) -> (&'static str, i64) {
    match entry {
        OutboxEntry::Approved(generation) => ("approved", generation.0 as i64),
        OutboxEntry::Confirmed(generation) => ("confirmed", generation.0 as i64),
    }
}

async fn next_ids(connection: &mut dyn Connection) -> Result<NextIds, StoreError> {
    let row = query(
        "SELECT (SELECT coalesce(max(id), 0) + 1 FROM revision),
                (SELECT coalesce(max(id), 0) + 1 FROM proposal),
                (SELECT coalesce(max(id), 0) + 1 FROM deployment)",
    )
    .fetch_one(connection)
    .await
    .map_err(StoreError::database("read the next numbers"))?;
    Ok(NextIds {
        revision: number(&row, 0).map(RevisionId)?,
        proposal: number(&row, 1).map(ProposalId)?,
        deployment: number(&row, 2).map(DeploymentId)?,
    })
}

/// Reads one robot's records, with the document of the generation that an acknowledgement names.
async fn ledger(
    connection: &mut dyn Connection,
    robot: &RobotId,
    answered: Option<Generation>,
) -> Result<RobotLedger, StoreError> {
    let failed = || StoreError::database("read a robot's records");
    let row = query("SELECT record FROM shadow WHERE robot = $1")
        .bind(robot.as_str())
        .fetch_optional(&mut *connection)
        .await
        .map_err(failed())?;
    let mut ledger = RobotLedger::new(robot.clone());
    if let Some(row) = row {
        ledger.shadow = record(&row, "shadow", 0)?;
    }
    let row = query("SELECT record FROM proposal WHERE robot = $1 AND state = 'proposed'")
        .bind(robot.as_str())
        .fetch_optional(&mut *connection)
        .await
        .map_err(failed())?;
    ledger.open = row.map(|row| record(&row, "proposal", 0)).transpose()?;
    let row = query("SELECT record FROM deployment WHERE ")
        .push(LIVE)
        .push(" AND robot = ")
        .push_bind(robot.as_str())
        .fetch_optional(&mut *connection)
        .await
        .map_err(failed())?;
    ledger.live = row.map(|row| record(&row, "deployment", 0)).transpose()?;
    if let Some(generation) = answered {
        ledger.answered = given_out(connection, robot, generation).await?;
    }
    for id in ledger.named_revisions() {
        let row = query("SELECT record FROM revision WHERE id = $1")
            .bind(id.0 as i64)
            .fetch_one(&mut *connection)
            .await
            .map_err(failed())?;
        ledger.revisions.insert(id, record(&row, "revision", 0)?);
    }
    Ok(ledger)
}

/// Reads the document that was signed under a generation.
async fn given_out(
    connection: &mut dyn Connection,
    robot: &RobotId,
    generation: Generation,
) -> Result<Option<GenerationRef>, StoreError> {
    let row = query("SELECT record FROM envelope WHERE robot = $1 AND generation = $2")
        .bind(robot.as_str())
        .bind(i64::try_from(generation.0).unwrap_or(i64::MAX))
        .fetch_optional(connection)
        .await
        .map_err(StoreError::database("read what was given out"))?;
    let of = |row: Row| {
        let envelope: Envelope = record(&row, "envelope", 0)?;
        let Named { revision } = parsed("envelope", &envelope.document)?;
        Ok(GenerationRef {
            generation,
            revision,
            sha256: envelope.sha256,
            chosen_by: None,
        })
    };
    row.map(of).transpose()
}

/// Revision that a signed document names.
#[derive(serde::Deserialize)]
struct Named {
    revision: RevisionId,
}
