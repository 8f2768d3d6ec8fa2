//! The approval policy that was set over the API: one row.

use fleetcal_model::Version;
use fleetcal_store::{StoreError, StoredPolicy};

use super::connection::Connection;
use super::query::query;
use super::records::number;
use super::row::{column, json, parsed, wall_time_or_null};
use super::value::Row;

/// Reads the stored policy.
pub(super) async fn read(connection: &mut dyn Connection) -> Result<StoredPolicy, StoreError> {
    let row = query("SELECT version, policy, by, at_ns, reason FROM policy")
        .fetch_one(connection)
        .await;
    policy_of(&row.map_err(StoreError::database("read the policy"))?)
}

fn policy_of(row: &Row) -> Result<StoredPolicy, StoreError> {
    let policy: Option<String> = column(row, "policy", 1)?;
    Ok(StoredPolicy {
        version: number(row, 0).map(Version)?,
        policy: policy.map(|json| parsed("policy", &json)).transpose()?,
        by: column(row, "policy", 2)?,
        at_ns: wall_time_or_null(row, "policy", 3)?,
        reason: column(row, "policy", 4)?,
    })
}

/// Stores the policy.
pub(super) async fn save(
    connection: &mut dyn Connection,
    stored: &StoredPolicy,
) -> Result<(), StoreError> {
    let policy = stored.policy.as_ref();
    let policy = policy.map(|policy| json("policy", policy)).transpose()?;
    query("UPDATE policy SET version = $1, policy = $2, by = $3, at_ns = $4, reason = $5")
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
