//! Audit rows, and with them all that a job may do.

use async_trait::async_trait;
use fleetcal_cluster::{Duty, Seat, Tenure};
use fleetcal_model::{AuditId, RobotId, WallTime};
use fleetcal_store::{AuditEntry, AuditRow, Records, StoreError};

use super::connection::Connection;
use super::dialect::Dialect;
use super::query::query;
use super::records;
use super::row::column;
use super::telemetry;
use super::transaction::SqlRecords;

/// Appends a row; the caller's transaction is the one of the change. Its number is the next one and
/// not a sequence's, which skips the numbers of undone transactions: a gap would look like a
/// removed row. Of two transactions that append at once, one is undone and runs again.
async fn append(connection: &mut dyn Connection, entry: &AuditEntry) -> Result<(), StoreError> {
    let last = query("SELECT id, link FROM audit ORDER BY id DESC LIMIT 1")
        .fetch_optional(connection)
        .await
        .map_err(StoreError::database("read the end of the audit"))?;
    let (last, previous): (i64, Option<String>) = match &last {
        Some(row) => (column(row, "audit", 0)?, column(row, "audit", 1)?),
        None => (0, None),
    };
    let row = entry.row(AuditId(last + 1));
    query(
        "INSERT INTO audit (id, at_ns, actor, authentication, role, request, action, subject,
             subject_id, robot, before, after, reason, address, link)
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14, $15)",
    )
    .bind(row.id.0)
    .bind(row.at_ns.0)
    .bind(&row.actor)
    .bind(&row.authentication)
    .bind(row.role.as_deref())
    .bind(row.request.as_deref())
    .bind(&row.action)
    .bind(&row.subject)
    .bind(&row.subject_id)
    .bind(row.robot.as_deref())
    .bind(row.before.as_ref().map(ToString::to_string))
    .bind(row.after.as_ref().map(ToString::to_string))
    .bind(&row.reason)
    .bind(row.address.as_deref())
    .bind(row.link_after(previous.as_deref()))
    .execute(connection)
    .await
    .map(drop)
    .map_err(StoreError::database("write the audit"))
}

#[async_trait]
impl Records for SqlRecords<'_> {
    async fn append_audit(&mut self, entry: &AuditEntry) -> Result<(), StoreError> {
        append(self.connection, entry).await
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
