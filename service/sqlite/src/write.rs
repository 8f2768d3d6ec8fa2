//! What telemetry does to the tables.

use std::collections::BTreeSet;

use fleetcal_domain::limits;
use fleetcal_domain::robot::GENERATIONS_MAX;
use fleetcal_model::WallTime;
use fleetcal_proto::estimate::EstimateDocument;
use fleetcal_store::backend::{Aged, Batch, Tier};
use fleetcal_store::{CheckpointRecord, CrossTrackRecord, HistoryRow, StoreError};
use sqlx::sqlite::SqliteConnection;

use super::row::{Keys, NS_PER_S, json, key_of};
use super::{accounts, columns, events};

/// Calibrations of a robot whose cross-track errors are kept, beside the first.
const CROSS_TRACKS_KEPT: i64 = GENERATIONS_MAX as i64 - 1;

/// Writes a batch.
pub(super) async fn write(
    connection: &mut SqliteConnection,
    keys: &mut Keys,
    batch: &Batch,
) -> Result<(), StoreError> {
    history(connection, keys, &batch.history).await?;
    for (estimate, received_ns) in &batch.current {
        current(connection, keys, estimate, *received_ns).await?;
    }
    for record in &batch.checkpoints {
        checkpoint(connection, keys, record).await?;
    }
    for record in &batch.cross_tracks {
        cross_track(connection, record).await?;
    }
    for write in &batch.events {
        events::write(connection, keys, write).await?;
    }
    for used in &batch.uses {
        accounts::note_use(connection, used).await?;
    }
    Ok(())
}

/// Writes seconds and merges them into their minutes and hours.
///
/// A second that was there already is overwritten, and its minute and hour are made again: the
/// same recording replayed with another wheelbase is not averaged with the first run.
async fn history(
    connection: &mut SqliteConnection,
    keys: &mut Keys,
    rows: &[HistoryRow],
) -> Result<(), StoreError> {
    let mut overwritten = BTreeSet::new();
    for row in rows {
        let received = WallTime(row.received_s * NS_PER_S);
        let key = key_of(connection, keys, &row.robot, received).await?;
        let insert = columns::INSERT_SECOND.as_str();
        if put_second(connection, insert, key, row, row.t_s).await? == 0 {
            put_second(
                connection,
                columns::REPLACE_SECOND.as_str(),
                key,
                row,
                row.t_s,
            )
            .await?;
            overwritten.insert((key, start(row.t_s, Tier::Minute)));
            continue;
        }
        for (tier, merge) in [
            (Tier::Minute, columns::MERGE_MINUTE.as_str()),
            (Tier::Hour, columns::MERGE_HOUR.as_str()),
        ] {
            put_second(connection, merge, key, row, start(row.t_s, tier)).await?;
        }
    }
    let hours: BTreeSet<_> = overwritten
        .iter()
        .map(|&(key, minute)| (key, start(minute, Tier::Hour)))
        .collect();
    for (key, minute) in overwritten {
        remake(
            connection,
            Tier::Minute,
            columns::REMAKE_MINUTE.as_str(),
            key,
            minute,
        )
        .await?;
    }
    for (key, hour) in hours {
        remake(
            connection,
            Tier::Hour,
            columns::REMAKE_HOUR.as_str(),
            key,
            hour,
        )
        .await?;
    }
    Ok(())
}

/// First second of the stretch that `t_s` is in.
const fn start(t_s: i64, tier: Tier) -> i64 {
    t_s - t_s.rem_euclid(tier.seconds())
}

/// Runs a statement that takes the columns of a second; gives the number of rows written.
async fn put_second(
    connection: &mut SqliteConnection,
    sql: &'static str,
    key: i64,
    row: &HistoryRow,
    t_s: i64,
) -> Result<u64, StoreError> {
    let mut query = sqlx::query(sql)
        .bind(t_s)
        .bind(key)
        .bind(row.received_s)
        .bind(i64::from(row.status))
        .bind(row.nis);
    for cell in &row.cells {
        query = query
            .bind(cell.map(|(value, _)| value))
            .bind(cell.map(|(_, sigma)| sigma));
    }
    let done = query
        .execute(connection)
        .await
        .map_err(StoreError::database("write a robot's history"))?;
    Ok(done.rows_affected())
}

async fn remake(
    connection: &mut SqliteConnection,
    tier: Tier,
    sql: &'static str,
    key: i64,
    start_s: i64,
) -> Result<(), StoreError> {
    let failed = || StoreError::database("roll up a robot's history");
    let delete = match tier {
        Tier::Hour => "DELETE FROM history_hour WHERE t = ?1 AND robot = ?2",
        Tier::Second | Tier::Minute => "DELETE FROM history_minute WHERE t = ?1 AND robot = ?2",
    };
    sqlx::query(delete)
        .bind(start_s)
        .bind(key)
        .execute(&mut *connection)
        .await
        .map_err(failed())?;
    sqlx::query(sql)
        .bind(key)
        .bind(start_s)
        .bind(start_s + tier.seconds())
        .execute(connection)
        .await
        .map_err(failed())?;
    Ok(())
}

async fn current(
    connection: &mut SqliteConnection,
    keys: &mut Keys,
    estimate: &EstimateDocument,
    received_ns: WallTime,
) -> Result<(), StoreError> {
    let key = key_of(connection, keys, &estimate.robot, received_ns).await?;
    sqlx::query(
        "INSERT INTO robot_current (robot, stamp_ns, received_ns, estimate)
         VALUES (?1, ?2, ?3, ?4)
         ON CONFLICT (robot) DO UPDATE SET stamp_ns = excluded.stamp_ns,
             received_ns = excluded.received_ns, estimate = excluded.estimate",
    )
    .bind(key)
    .bind(estimate.stamp_ns.0)
    .bind(received_ns.0)
    .bind(json("robot_current", estimate)?)
    .execute(connection)
    .await
    .map_err(StoreError::database("write a robot's estimate"))?;
    Ok(())
}

async fn checkpoint(
    connection: &mut SqliteConnection,
    keys: &mut Keys,
    record: &CheckpointRecord,
) -> Result<(), StoreError> {
    let key = key_of(connection, keys, &record.robot, record.received_ns).await?;
    sqlx::query(
        "INSERT INTO checkpoint (robot, stamp_ns, received_ns, state) VALUES (?1, ?2, ?3, ?4)
         ON CONFLICT (robot) DO UPDATE SET stamp_ns = excluded.stamp_ns,
             received_ns = excluded.received_ns, state = excluded.state",
    )
    .bind(key)
    .bind(record.stamp_ns.0)
    .bind(record.received_ns.0)
    .bind(record.state.as_slice())
    .execute(connection)
    .await
    .map_err(StoreError::database("write an estimator's state"))?;
    Ok(())
}

async fn cross_track(
    connection: &mut SqliteConnection,
    record: &CrossTrackRecord,
) -> Result<(), StoreError> {
    let failed = || StoreError::database("write how a robot follows its path");
    sqlx::query(
        "INSERT INTO cross_track (robot, generation, errors) VALUES (?1, ?2, ?3)
         ON CONFLICT (robot, generation) DO UPDATE SET errors = excluded.errors",
    )
    .bind(record.robot.as_str())
    .bind(record.generation.0 as i64)
    .bind(json("cross_track", &record.errors)?)
    .execute(&mut *connection)
    .await
    .map_err(failed())?;
    // Beside what it drove with at first, the latest ones are kept.
    sqlx::query(
        "DELETE FROM cross_track WHERE robot = ?1 AND generation > 0 AND generation NOT IN
         (SELECT generation FROM cross_track WHERE robot = ?1 ORDER BY generation DESC LIMIT ?2)",
    )
    .bind(record.robot.as_str())
    .bind(CROSS_TRACKS_KEPT)
    .execute(connection)
    .await
    .map_err(failed())?;
    Ok(())
}

/// Writes a row that nothing reads.
pub(super) async fn probe(
    connection: &mut SqliteConnection,
    now: WallTime,
) -> Result<(), StoreError> {
    sqlx::query("UPDATE probe SET written_ns = ?1")
        .bind(now.0)
        .execute(connection)
        .await
        .map_err(StoreError::database("write at all"))?;
    Ok(())
}

/// Deletes what is older than `before_s`, a limited number of rows of each table; gives their
/// number.
pub(super) async fn prune(
    connection: &mut SqliteConnection,
    aged: Aged,
    before_s: i64,
) -> Result<u64, StoreError> {
    let mut pruned = 0;
    for &(sql, unit) in deletes(aged) {
        let done = sqlx::query(sql)
            .bind(before_s.saturating_mul(unit))
            .bind(limits::RETENTION_ROWS_MAX)
            .execute(&mut *connection)
            .await
            .map_err(StoreError::database("delete old rows"))?;
        pruned += done.rows_affected();
    }
    Ok(pruned)
}

/// The statements that delete old rows, and what a second is in the unit of their column of time.
const fn deletes(aged: Aged) -> &'static [(&'static str, i64)] {
    match aged {
        Aged::Seconds => &[(
            "DELETE FROM history_second WHERE (t, robot) IN (SELECT t, robot
             FROM history_second WHERE received < ?1 ORDER BY received LIMIT ?2)",
            1,
        )],
        Aged::Minutes => &[(
            "DELETE FROM history_minute WHERE (t, robot) IN (SELECT t, robot
             FROM history_minute WHERE received < ?1 ORDER BY received LIMIT ?2)",
            1,
        )],
        Aged::Hours => &[(
            "DELETE FROM history_hour WHERE (t, robot) IN (SELECT t, robot
             FROM history_hour WHERE received < ?1 ORDER BY received LIMIT ?2)",
            1,
        )],
        Aged::Events => &[(
            "DELETE FROM robot_event WHERE id IN (SELECT id FROM robot_event
             WHERE received_ns < ?1 ORDER BY received_ns LIMIT ?2)",
            NS_PER_S,
        )],
        Aged::Answers => &[
            (
                "DELETE FROM idempotency WHERE (scope, key) IN (SELECT scope, key
                 FROM idempotency WHERE received < ?1 ORDER BY received LIMIT ?2)",
                1,
            ),
            (
                "DELETE FROM proposal_request WHERE (robot, key) IN (SELECT robot, key
                 FROM proposal_request WHERE received < ?1 ORDER BY received LIMIT ?2)",
                1,
            ),
            (
                "DELETE FROM access_idempotency WHERE (made, key) IN (SELECT made, key
                 FROM access_idempotency WHERE received_ns < ?1 ORDER BY received_ns LIMIT ?2)",
                NS_PER_S,
            ),
        ],
        Aged::Alerts => &[(
            "DELETE FROM alert WHERE id IN (SELECT id FROM alert
             WHERE ended_ns < ?1 ORDER BY ended_ns LIMIT ?2)",
            NS_PER_S,
        )],
    }
}
