//! Robots' configurations.

use fleetcal_store::backend::RobotWrite;
use fleetcal_store::{AuditEntry, StoreError};
use sqlx::sqlite::SqliteConnection;

use super::audit;
use super::records::number;
use super::row::{Keys, column, count, json, key_of};

/// Writes a robot's configuration; gives its new version.
pub(super) async fn configure(
    connection: &mut SqliteConnection,
    keys: &mut Keys,
    write: &RobotWrite,
) -> Result<u64, StoreError> {
    let failed = || StoreError::database("write a robot's configuration");
    let row = sqlx::query("SELECT version, config FROM robot WHERE id = ?1")
        .bind(write.robot.as_str())
        .fetch_optional(&mut *connection)
        .await
        .map_err(failed())?;
    let (found, before) = match &row {
        Some(row) => (number(row, 0)?, column::<Option<String>>(row, "robot", 1)?),
        None => (0, None),
    };
    if !write.expected.accepts(found) {
        return Err(StoreError::VersionConflict {
            robot: write.robot.clone(),
            found,
        });
    }
    let key = key_of(connection, keys, &write.robot, write.now_ns).await?;
    let after = json("robot", &write.config)?;
    let version: i64 = sqlx::query_scalar(
        "UPDATE robot SET config = ?2, version = version + 1, updated_ns = ?3
         WHERE key = ?1 RETURNING version",
    )
    .bind(key)
    .bind(&after)
    .bind(write.now_ns)
    .fetch_one(&mut *connection)
    .await
    .map_err(failed())?;
    let entry = AuditEntry {
        at_ns: write.now_ns,
        actor: write.actor.clone(),
        action: match before {
            Some(_) => "robot.configure",
            None => "robot.register",
        },
        subject: "robot",
        subject_id: write.robot.as_str().to_owned(),
        robot: Some(write.robot.clone()),
        before: before.as_deref().map(document).transpose()?,
        after: Some(document(&after)?),
        reason: None,
    };
    audit::append(connection, &entry).await?;
    count("robot", version)
}

/// A stored configuration, for the audit.
fn document(json: &str) -> Result<serde_json::Value, StoreError> {
    serde_json::from_str(json).map_err(|error| StoreError::Corrupt {
        table: "robot",
        reason: error.to_string(),
    })
}
