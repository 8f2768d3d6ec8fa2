//! Audit rows.

use fleetcal_store::{AuditEntry, StoreError};
use sqlx::sqlite::SqliteConnection;

/// Appends a row; the caller's transaction is the one of the change.
pub(super) async fn append(
    connection: &mut SqliteConnection,
    entry: &AuditEntry,
) -> Result<i64, StoreError> {
    let actor = &entry.actor;
    let request = actor.request.as_ref();
    sqlx::query_scalar(
        "INSERT INTO audit (at_ns, actor, authentication, role, request, action, subject,
             subject_id, robot, before, after, reason, address)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13) RETURNING id",
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

#[cfg(test)]
mod tests {
    use fleetcal_domain::access::Actor;
    use fleetcal_domain::approval::DeploymentAction;
    use fleetcal_domain::audit::Action;
    use fleetcal_model::WallTime;
    use sqlx::Connection;

    use super::*;

    #[tokio::test]
    async fn a_row_is_never_changed_and_never_deleted() {
        let mut connection = SqliteConnection::connect("sqlite::memory:").await.unwrap();
        super::super::MIGRATIONS
            .run_direct(None, &mut connection, false)
            .await
            .unwrap();
        let entry = AuditEntry {
            at_ns: WallTime(7),
            actor: Actor::service(),
            action: Action::Deployment(DeploymentAction::Offer),
            subject_id: "1".to_owned(),
            robot: None,
            before: None,
            after: Some(serde_json::json!({ "state": "offered" })),
            reason: None,
        };
        assert_eq!(append(&mut connection, &entry).await.unwrap(), 1);
        for sql in ["UPDATE audit SET actor = 'x'", "DELETE FROM audit"] {
            let refused = sqlx::query(sql).execute(&mut connection).await.unwrap_err();
            assert!(refused.to_string().contains("never"), "{refused}");
        }
    }
}
