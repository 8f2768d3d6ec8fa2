//! Statements of telemetry.

use std::collections::BTreeSet;

use fleetcal_domain::limits;
use fleetcal_domain::robot::GENERATIONS_MAX;
use fleetcal_model::WallTime;
use fleetcal_proto::estimate::EstimateDocument;
use fleetcal_store::backend::{Aged, Batch, Tier};
use fleetcal_store::{
    CheckpointRecord, CrossTrackRecord, EventKind, EventSource, HistoryRow, StoreError,
};

use super::connection::Connection;
use super::history::STATEMENTS;
use super::query::query;
use super::row::{Keys, NS_PER_S, json, key_of};
use super::{accounts, events};

/// Calibrations of a robot whose cross-track errors are kept, besides the first.
const CROSS_TRACKS_KEPT: i64 = GENERATIONS_MAX as i64 - 1;

/// Writes a batch, its history one second after another.
///
/// # Errors
/// The database's failure.
pub async fn write(
    connection: &mut dyn Connection,
    keys: &mut Keys,
    batch: &Batch,
) -> Result<(), StoreError> {
    history(connection, keys, &batch.history).await?;
    write_beside_history(connection, keys, batch).await
}

/// Writes the parts of a batch other than seconds of history.
///
/// # Errors
/// The database's failure.
pub async fn write_beside_history(
    connection: &mut dyn Connection,
    keys: &mut Keys,
    batch: &Batch,
) -> Result<(), StoreError> {
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
    connection: &mut dyn Connection,
    keys: &mut Keys,
    rows: &[HistoryRow],
) -> Result<(), StoreError> {
    let statements = &*STATEMENTS;
    let mut overwritten = BTreeSet::new();
    for row in rows {
        let received = WallTime(row.received_s * NS_PER_S);
        let key = key_of(connection, keys, &row.robot, received).await?;
        if put_second(connection, &statements.insert_second, key, row, row.t_s).await? == 0 {
            put_second(connection, &statements.replace_second, key, row, row.t_s).await?;
            overwritten.insert((key, start(row.t_s, Tier::Minute)));
            continue;
        }
        let (minute, hour) = (start(row.t_s, Tier::Minute), start(row.t_s, Tier::Hour));
        put_second(connection, &statements.merge_minute, key, row, minute).await?;
        put_second(connection, &statements.merge_hour, key, row, hour).await?;
    }
    let hours: BTreeSet<_> = overwritten
        .iter()
        .map(|&(key, minute)| (key, start(minute, Tier::Hour)))
        .collect();
    for (key, minute) in overwritten {
        remake(connection, Tier::Minute, key, minute).await?;
    }
    for (key, hour) in hours {
        remake(connection, Tier::Hour, key, hour).await?;
    }
    Ok(())
}

/// Returns the first second of the stretch of a tier that contains `t_s`.
const fn start(t_s: i64, tier: Tier) -> i64 {
    t_s - t_s.rem_euclid(tier.seconds())
}

/// Runs a statement with the columns of a second; returns the number of rows written.
async fn put_second(
    connection: &mut dyn Connection,
    sql: &'static str,
    key: i64,
    row: &HistoryRow,
    t_s: i64,
) -> Result<u64, StoreError> {
    let mut query = query(sql)
        .bind(t_s)
        .bind(key)
        .bind(row.received_s)
        .bind(row.status.number())
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
    Ok(done)
}

/// Makes a minute again from its seconds, or an hour from its minutes.
async fn remake(
    connection: &mut dyn Connection,
    tier: Tier,
    key: i64,
    start_s: i64,
) -> Result<(), StoreError> {
    let failed = || StoreError::database("roll up a robot's history");
    let statements = &*STATEMENTS;
    let (delete, merge) = match tier {
        Tier::Hour => (
            "DELETE FROM history_hour WHERE t = $1 AND robot = $2",
            &statements.remake_hour,
        ),
        Tier::Second | Tier::Minute => (
            "DELETE FROM history_minute WHERE t = $1 AND robot = $2",
            &statements.remake_minute,
        ),
    };
    query(delete)
        .bind(start_s)
        .bind(key)
        .execute(connection)
        .await
        .map_err(failed())?;
    query(merge.as_str())
        .bind(key)
        .bind(start_s)
        .bind(start_s + tier.seconds())
        .execute(connection)
        .await
        .map_err(failed())?;
    Ok(())
}

async fn current(
    connection: &mut dyn Connection,
    keys: &mut Keys,
    estimate: &EstimateDocument,
    received_ns: WallTime,
) -> Result<(), StoreError> {
    let key = key_of(connection, keys, &estimate.robot, received_ns).await?;
    query(
        "INSERT INTO robot_current (robot, stamp_ns, received_ns, estimate)
         VALUES ($1, $2, $3, $4)
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
    connection: &mut dyn Connection,
    keys: &mut Keys,
    record: &CheckpointRecord,
) -> Result<(), StoreError> {
    let key = key_of(connection, keys, &record.robot, record.received_ns).await?;
    query(
        "INSERT INTO checkpoint (robot, stamp_ns, received_ns, state) VALUES ($1, $2, $3, $4)
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
    connection: &mut dyn Connection,
    record: &CrossTrackRecord,
) -> Result<(), StoreError> {
    let failed = || StoreError::database("write how a robot follows its path");
    query(
        "INSERT INTO cross_track (robot, generation, errors) VALUES ($1, $2, $3)
         ON CONFLICT (robot, generation) DO UPDATE SET errors = excluded.errors",
    )
    .bind(record.robot.as_str())
    .bind(record.generation.0 as i64)
    .bind(json("cross_track", &record.errors)?)
    .execute(&mut *connection)
    .await
    .map_err(failed())?;
    // Beside what it drove with at first, the latest ones are kept.
    query(
        "DELETE FROM cross_track WHERE robot = $1 AND generation > 0 AND generation NOT IN
         (SELECT generation FROM cross_track WHERE robot = $1 ORDER BY generation DESC LIMIT $2)",
    )
    .bind(record.robot.as_str())
    .bind(CROSS_TRACKS_KEPT)
    .execute(connection)
    .await
    .map_err(failed())?;
    Ok(())
}

/// Writes a row that is never read.
pub(crate) async fn probe(
    connection: &mut dyn Connection,
    now: WallTime,
) -> Result<(), StoreError> {
    query("UPDATE probe SET written_ns = $1")
        .bind(now.0)
        .execute(connection)
        .await
        .map_err(StoreError::database("write at all"))?;
    Ok(())
}

/// Records the service's start in the history of every robot whose estimator continues from a
/// checkpoint.
///
/// # Errors
/// The database's failure.
pub async fn note_start(connection: &mut dyn Connection, now: WallTime) -> Result<(), StoreError> {
    query(
        "INSERT INTO robot_event (robot, kind, stamp_ns, received_ns, source)
         SELECT robot, $1, stamp_ns, $2, $3 FROM checkpoint",
    )
    .bind(EventKind::ServiceStarted.as_str())
    .bind(now.0)
    .bind(EventSource::Service.as_str())
    .execute(connection)
    .await
    .map_err(StoreError::database("note the service's start"))?;
    Ok(())
}

/// Deletes rows older than `before_s`, a limited number of each table; returns their number.
///
/// # Errors
/// The database's failure.
pub async fn prune(
    connection: &mut dyn Connection,
    aged: Aged,
    before_s: i64,
) -> Result<u64, StoreError> {
    let mut pruned = 0;
    for &(sql, unit) in deletes(aged) {
        let done = query(sql)
            .bind(before_s.saturating_mul(unit))
            .bind(limits::RETENTION_ROWS_MAX)
            .execute(&mut *connection)
            .await
            .map_err(StoreError::database("delete old rows"))?;
        pruned += done;
    }
    Ok(pruned)
}

/// Deletes seconds older than `before_s` that are in no day's partition, a limited number; returns
/// their number.
///
/// # Errors
/// The database's failure.
pub async fn prune_seconds_beside_days(
    connection: &mut dyn Connection,
    before_s: i64,
) -> Result<u64, StoreError> {
    query(
        "DELETE FROM history_second_default WHERE (t, robot) IN (SELECT t, robot
         FROM history_second_default WHERE received < $1 LIMIT $2)",
    )
    .bind(before_s)
    .bind(limits::RETENTION_ROWS_MAX)
    .execute(connection)
    .await
    .map_err(StoreError::database("delete old rows"))
}

/// Returns the statements that delete old rows, and the length of a second in the unit of their
/// column of time.
const fn deletes(aged: Aged) -> &'static [(&'static str, i64)] {
    match aged {
        Aged::Seconds => &[(
            "DELETE FROM history_second WHERE (t, robot) IN (SELECT t, robot
             FROM history_second WHERE received < $1 ORDER BY received LIMIT $2)",
            1,
        )],
        Aged::Minutes => &[(
            "DELETE FROM history_minute WHERE (t, robot) IN (SELECT t, robot
             FROM history_minute WHERE received < $1 ORDER BY received LIMIT $2)",
            1,
        )],
        Aged::Hours => &[(
            "DELETE FROM history_hour WHERE (t, robot) IN (SELECT t, robot
             FROM history_hour WHERE received < $1 ORDER BY received LIMIT $2)",
            1,
        )],
        Aged::Events => &[(
            "DELETE FROM robot_event WHERE id IN (SELECT id FROM robot_event
             WHERE received_ns < $1 ORDER BY received_ns LIMIT $2)",
            NS_PER_S,
        )],
        Aged::Answers => &[
            (
                "DELETE FROM idempotency WHERE (scope, key) IN (SELECT scope, key
                 FROM idempotency WHERE received < $1 ORDER BY received LIMIT $2)",
                1,
            ),
            (
                "DELETE FROM proposal_request WHERE (robot, key) IN (SELECT robot, key
                 FROM proposal_request WHERE received < $1 ORDER BY received LIMIT $2)",
                1,
            ),
            (
                "DELETE FROM access_idempotency WHERE (made, key) IN (SELECT made, key
                 FROM access_idempotency WHERE received_ns < $1 ORDER BY received_ns LIMIT $2)",
                NS_PER_S,
            ),
        ],
        Aged::Alerts => &[(
            "DELETE FROM alert WHERE id IN (SELECT id FROM alert
             WHERE ended_ns < $1 ORDER BY ended_ns LIMIT $2)",
            NS_PER_S,
        )],
        Aged::Certificates => &[(
            "DELETE FROM certificate WHERE number IN (SELECT number FROM certificate
             WHERE verified_ns < $1 ORDER BY verified_ns LIMIT $2)",
            NS_PER_S,
        )],
    }
}
