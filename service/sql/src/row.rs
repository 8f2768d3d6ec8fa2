//! Rows of every table: columns in and out, and robots' keys.

use std::collections::HashMap;

use fleetcal_model::{RobotId, RobotTime, WallTime};
use fleetcal_store::StoreError;

use crate::connection::Connection;
use crate::query::query_scalar;
use crate::value::{FromValue, Row};

/// Nanoseconds in a second.
pub(super) const NS_PER_S: i64 = 1_000_000_000;

/// Known keys of robots' rows.
pub type Keys = HashMap<RobotId, i64>;

/// Returns the robot's key; makes a row without configuration for a new robot.
///
/// # Errors
/// The database's failure.
pub async fn key_of(
    connection: &mut dyn Connection,
    keys: &mut Keys,
    robot: &RobotId,
    now: WallTime,
) -> Result<i64, StoreError> {
    if let Some(key) = keys.get(robot) {
        return Ok(*key);
    }
    let key: i64 = query_scalar(
        "INSERT INTO robot (id, created_ns, updated_ns) VALUES ($1, $2, $2)
         ON CONFLICT (id) DO UPDATE SET id = excluded.id RETURNING key",
    )
    .bind(robot.as_str())
    .bind(now.0)
    .fetch_one(connection)
    .await
    .map_err(StoreError::database("write a robot"))?;
    keys.insert(robot.clone(), key);
    Ok(key)
}

pub(super) fn robot_id(
    row: &Row,
    table: &'static str,
    index: usize,
) -> Result<RobotId, StoreError> {
    let id: String = column(row, table, index)?;
    RobotId::parse(&id).map_err(corrupt(table))
}

pub(super) fn column<T: FromValue>(
    row: &Row,
    table: &'static str,
    index: usize,
) -> Result<T, StoreError> {
    row.get(index).map_err(corrupt(table))
}

pub(super) fn wall_time(
    row: &Row,
    table: &'static str,
    index: usize,
) -> Result<WallTime, StoreError> {
    column(row, table, index).map(WallTime)
}

pub(super) fn wall_time_or_null(
    row: &Row,
    table: &'static str,
    index: usize,
) -> Result<Option<WallTime>, StoreError> {
    let ns: Option<i64> = column(row, table, index)?;
    Ok(ns.map(WallTime))
}

pub(super) fn robot_time(
    row: &Row,
    table: &'static str,
    index: usize,
) -> Result<RobotTime, StoreError> {
    column(row, table, index).map(RobotTime)
}

pub(super) fn parsed<T: serde::de::DeserializeOwned>(
    table: &'static str,
    json: &str,
) -> Result<T, StoreError> {
    serde_json::from_str(json).map_err(corrupt(table))
}

pub(super) fn corrupt<E: std::fmt::Display>(table: &'static str) -> impl FnOnce(E) -> StoreError {
    move |error| StoreError::Corrupt {
        table,
        reason: error.to_string(),
    }
}

pub(super) fn json<T: serde::Serialize>(
    table: &'static str,
    value: &T,
) -> Result<String, StoreError> {
    serde_json::to_string(value).map_err(|error| StoreError::Corrupt {
        table,
        reason: error.to_string(),
    })
}
