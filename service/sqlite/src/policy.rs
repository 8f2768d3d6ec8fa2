//! The approval policy that was set over the API: one row.

use fleetcal_model::Version;
use fleetcal_store::{StoreError, StoredPolicy};
use sqlx::SqliteExecutor;
use sqlx::sqlite::{SqliteConnection, SqliteRow};

use super::records::number;
use super::row::{column, json, parsed, wall_time_or_null};

/// The policy that was set.
pub(super) async fn read(executor: impl SqliteExecutor<'_>) -> Result<StoredPolicy, StoreError> {
    let row = sqlx::query("SELECT version, policy, by, at_ns, reason FROM policy")
        .fetch_one(executor)
        .await;
    policy_of(&row.map_err(StoreError::database("read the policy"))?)
}

fn policy_of(row: &SqliteRow) -> Result<StoredPolicy, StoreError> {
    let policy: Option<String> = column(row, "policy", 1)?;
    Ok(StoredPolicy {
        version: number(row, 0).map(Version)?,
        policy: policy.map(|json| parsed("policy", &json)).transpose()?,
        by: column(row, "policy", 2)?,
        at_ns: wall_time_or_null(row, "policy", 3)?,
        reason: column(row, "policy", 4)?,
    })
}

/// Keeps the policy.
pub(super) async fn save(
    connection: &mut SqliteConnection,
    stored: &StoredPolicy,
) -> Result<(), StoreError> {
    let policy = stored.policy.as_ref();
    let policy = policy.map(|policy| json("policy", policy)).transpose()?;
    sqlx::query("UPDATE policy SET version = ?1, policy = ?2, by = ?3, at_ns = ?4, reason = ?5")
        .bind(stored.version.0 as i64)
        .bind(policy)
        .bind(&stored.by)
        .bind(stored.at_ns.map(|at| at.0))
        .bind(&stored.reason)
        .execute(connection)
        .await
        .map_err(StoreError::database("write the policy"))?;
    Ok(())
}
