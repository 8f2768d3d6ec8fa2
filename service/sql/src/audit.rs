//! Audit rows, and with them all that a job may do.

use async_trait::async_trait;
use fleetcal_cluster::{Duty, Seat, Tenure};
use fleetcal_model::{AuditId, RobotId, WallTime};
use fleetcal_store::{AuditEntry, AuditRow, Records, StoreError};

use super::connection::Connection;
use super::dialect::Dialect;
use super::query::{query, query_scalar};
use super::records;
use super::telemetry;
use super::transaction::SqlRecords;

/// Appends a row; the caller's transaction is the one of the change. Its number is the next one and
/// not a sequence's, which skips the numbers of undone transactions: a gap would look like a
/// removed row.
async fn append(connection: &mut dyn Connection, entry: &AuditEntry) -> Result<i64, StoreError> {
    let actor = &entry.actor;
    let request = actor.request.as_ref();
    query_scalar(
        "INSERT INTO audit (id, at_ns, actor, authentication, role, request, action, subject,
             subject_id, robot, before, after, reason, address)
         VALUES ((SELECT coalesce(max(id), 0) + 1 FROM audit),
             $1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13) RETURNING id",
    )
    .bind(entry.at_ns.0)
    .bind(&actor.name)
    .bind(actor.authentication.as_str())
    .bind(actor.role.map(fleetcal_domain::access::Role::as_str))
    .bind(request.and_then(|request| request.id.as_deref()))
    .bind(entry.action.as_str())
    .bind(entry.action.subject())
    .bind(&entry.subject_id)
    .bind(entry.robot.as_ref().map(fleetcal_proto::RobotId::as_str))
    .bind(entry.before.as_ref().map(ToString::to_string))
    .bind(entry.after.as_ref().map(ToString::to_string))
    .bind(&entry.reason)
    .bind(request.and_then(|request| request.address.as_deref()))
    .fetch_one(connection)
    .await
    .map_err(StoreError::database("write the audit"))
}

#[async_trait]
impl Records for SqlRecords<'_> {
    async fn append_audit(&mut self, entry: &AuditEntry) -> Result<(), StoreError> {
        append(self.connection, entry).await.map(drop)
    }

    async fn notes_after(
        &mut self,
        robot: &RobotId,
        after: AuditId,
        limit: u32,
    ) -> Result<Vec<AuditRow>, StoreError> {
        records::notes_after(self.connection, robot, after, limit).await
    }

    async fn holds_tenure(&mut self, tenure: &Tenure) -> Result<bool, StoreError> {
        match self.connection.dialect() {
            // One service has all robots.
            Dialect::Sqlite => Ok(true),
            // Whoever ends the tenure changes this row, waits for this transaction, and lets it run
            // again when it was faster: a snapshot alone would show what was.
            Dialect::Postgres => query(
                "SELECT 1 FROM robot_owner
                 WHERE robot = (SELECT key FROM robot WHERE id = $1)
                     AND instance = $2 AND incarnation = $3 AND claim = $4 FOR SHARE",
            )
            .bind(tenure.robot.as_str())
            .bind(tenure.seat.instance.as_str())
            .bind(tenure.seat.incarnation.0)
            .bind(tenure.claim.0)
            .fetch_optional(self.connection)
            .await
            .map(|found| found.is_some())
            .map_err(StoreError::database("say who estimates a robot")),
        }
    }

    async fn holds_duty(&mut self, seat: &Seat, duty: Duty) -> Result<bool, StoreError> {
        match self.connection.dialect() {
            // One service has all duties.
            Dialect::Sqlite => Ok(true),
            // As with a tenure.
            Dialect::Postgres => query(
                "SELECT 1 FROM duty
                 WHERE name = $1 AND instance = $2 AND incarnation = $3 FOR SHARE",
            )
            .bind(duty.name())
            .bind(seat.instance.as_str())
            .bind(seat.incarnation.0)
            .fetch_optional(self.connection)
            .await
            .map(|found| found.is_some())
            .map_err(StoreError::database("say who has a duty")),
        }
    }

    async fn prove_writable(&mut self, now: WallTime) -> Result<(), StoreError> {
        telemetry::probe(self.connection, now).await
    }
}
