//! The approval policy that was set over the API: one row.

use fleetcal_domain::approval::Policy;
use fleetcal_store::{AuditEntry, PolicyWrite, StoreError, StoredPolicy};
use sqlx::SqliteExecutor;
use sqlx::sqlite::{SqliteConnection, SqliteRow};

use super::audit;
use super::records::{may_change, number};
use super::row::column;

const SELECT: &str = "SELECT version, policy, by, at_ns, reason FROM policy";

/// The policy that was set.
pub(super) async fn read(executor: impl SqliteExecutor<'_>) -> Result<StoredPolicy, StoreError> {
    let row = sqlx::query(SELECT).fetch_one(executor).await;
    policy_of(&row.map_err(StoreError::database("read the policy"))?)
}

/// The rules in the transaction that the connection is in: those that were set, or else `given`.
pub(super) async fn in_force(
    connection: &mut SqliteConnection,
    given: &Policy,
) -> Result<Policy, StoreError> {
    Ok(read(connection).await?.policy.unwrap_or(*given))
}

fn policy_of(row: &SqliteRow) -> Result<StoredPolicy, StoreError> {
    let corrupt = |error: serde_json::Error| StoreError::Corrupt {
        table: "policy",
        reason: error.to_string(),
    };
    let policy: Option<String> = column(row, "policy", 1)?;
    Ok(StoredPolicy {
        version: number(row, 0)?,
        policy: policy
            .map(|json| serde_json::from_str(&json).map_err(corrupt))
            .transpose()?,
        by: column(row, "policy", 2)?,
        at_ns: column(row, "policy", 3)?,
        reason: column(row, "policy", 4)?,
    })
}

/// Sets the policy.
pub(super) async fn write(
    connection: &mut SqliteConnection,
    write: &PolicyWrite,
) -> Result<StoredPolicy, StoreError> {
    let before = read(&mut *connection).await?;
    may_change(before.version, write.version, &write.reason)?;
    let after = StoredPolicy {
        version: before.version + 1,
        policy: write.policy,
        by: Some(write.actor.name.clone()),
        at_ns: Some(write.now_ns),
        reason: Some(write.reason.clone()),
    };
    let policy = after.policy.map(|policy| serde_json::to_string(&policy));
    let policy = policy.transpose().map_err(|error| StoreError::Corrupt {
        table: "policy",
        reason: error.to_string(),
    })?;
    sqlx::query("UPDATE policy SET version = ?1, policy = ?2, by = ?3, at_ns = ?4, reason = ?5")
        .bind(after.version as i64)
        .bind(policy)
        .bind(&after.by)
        .bind(after.at_ns)
        .bind(&after.reason)
        .execute(&mut *connection)
        .await
        .map_err(StoreError::database("write the policy"))?;
    let entry = AuditEntry {
        at_ns: write.now_ns,
        actor: write.actor.clone(),
        action: "policy.change",
        subject: "policy",
        subject_id: "1".to_owned(),
        robot: None,
        before: serde_json::to_value(&before).ok(),
        after: serde_json::to_value(&after).ok(),
        reason: Some(write.reason.clone()),
    };
    audit::append(connection, &entry).await?;
    Ok(after)
}
