//! Audit rows.

use sqlx::sqlite::SqliteConnection;

use crate::store::audit::AuditEntry;
use crate::store::error::StoreError;

/// Appends a row; the caller's transaction is the one of the change.
pub(super) async fn append(
    connection: &mut SqliteConnection,
    entry: &AuditEntry,
) -> Result<i64, StoreError> {
    let actor = &entry.actor;
    sqlx::query_scalar(
        "INSERT INTO audit (at_ns, actor, authentication, role, request, action, subject,
             subject_id, robot, before, after, reason)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12) RETURNING id",
    )
    .bind(entry.at_ns)
    .bind(&actor.name)
    .bind(actor.authentication.as_str())
    .bind(actor.role.map(crate::access::Role::as_str))
    .bind(&actor.request)
    .bind(entry.action)
    .bind(entry.subject)
    .bind(&entry.subject_id)
    .bind(entry.robot.as_ref().map(fleetcal_proto::RobotId::as_str))
    .bind(entry.before.as_ref().map(ToString::to_string))
    .bind(entry.after.as_ref().map(ToString::to_string))
    .bind(&entry.reason)
    .fetch_one(connection)
    .await
    .map_err(StoreError::database("write the audit"))
}
