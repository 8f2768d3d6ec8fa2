//! Limit of attempts to sign in, over all instances: the generic cell rate algorithm (ITU-T
//! I.371), which keeps one time a key, by the database's clock.

use std::time::Duration;

use fleetcal_domain::limits;
use fleetcal_store::StoreError;
use fleetcal_store::cluster::Try;

use super::seat::ns;
use crate::connection::Session;

/// Counts an attempt under each of `tries` until one is excessive; returns the time to wait in that
/// case.
pub(super) async fn count(
    session: &mut Session,
    tries: &[Try],
) -> Result<Option<Duration>, StoreError> {
    let mut wait = None;
    for one in tries {
        wait = count_as(session, one).await?;
        if wait.is_some() {
            break;
        }
    }
    make_room(session).await?;
    Ok(wait)
}

async fn count_as(session: &mut Session, one: &Try) -> Result<Option<Duration>, StoreError> {
    const COUNTED: &str = "
        INSERT INTO sign_in_try AS t (key, worked_off_ns) VALUES ($1, clock_ns() + $2)
        ON CONFLICT (key) DO UPDATE SET
            worked_off_ns = greatest(t.worked_off_ns, clock_ns()) + $2
        WHERE t.worked_off_ns - clock_ns() <= $3";
    const AHEAD: &str =
        "SELECT greatest(worked_off_ns - clock_ns() - $2, 0) FROM sign_in_try WHERE key = $1";
    let failed = || StoreError::database("count a try to sign in");
    let full = ns(one.every * one.burst.saturating_sub(1));
    let query = sqlx::query(COUNTED)
        .bind(one.key.as_str())
        .bind(ns(one.every))
        .bind(full);
    if session.execute_query(query).await.map_err(failed())? > 0 {
        return Ok(None);
    }
    let query = sqlx::query_as(AHEAD).bind(one.key.as_str()).bind(full);
    let ahead: Vec<(i64,)> = session.fetch(query).await.map_err(failed())?;
    let ahead = ahead.first().map_or(0, |(ahead,)| *ahead);
    Ok(Some(Duration::from_nanos(ahead.unsigned_abs())))
}

/// Deletes keys that are worked off, and the earliest ones beyond the limit. Rows locked by others
/// are skipped, so that no transaction waits for two rows.
async fn make_room(session: &mut Session) -> Result<(), StoreError> {
    const DELETED: &str = "
        DELETE FROM sign_in_try WHERE key IN (
            SELECT key FROM sign_in_try WHERE worked_off_ns <= clock_ns()
                OR worked_off_ns < (SELECT worked_off_ns FROM sign_in_try
                    ORDER BY worked_off_ns DESC OFFSET $1 LIMIT 1)
            FOR UPDATE SKIP LOCKED
        )";
    let max = i64::try_from(limits::SIGN_IN_KEYS_MAX).unwrap_or(i64::MAX);
    let deleted = session.execute_query(sqlx::query(DELETED).bind(max)).await;
    deleted
        .map(drop)
        .map_err(StoreError::database("forget tries to sign in"))
}

/// Stores a pair of address and name that was used for signing in, and deletes the oldest ones
/// beyond the limit. Rows locked by others are skipped.
pub(super) async fn note_pair(session: &mut Session, pair: &str) -> Result<(), StoreError> {
    const NOTED: &str = "
        INSERT INTO sign_in_pair (pair, right_at_ns) VALUES ($1, clock_ns())
        ON CONFLICT (pair) DO UPDATE SET right_at_ns = excluded.right_at_ns";
    const DELETED: &str = "
        DELETE FROM sign_in_pair WHERE pair IN (
            SELECT pair FROM sign_in_pair
                WHERE right_at_ns < (SELECT right_at_ns FROM sign_in_pair
                    ORDER BY right_at_ns DESC OFFSET $1 LIMIT 1)
            FOR UPDATE SKIP LOCKED
        )";
    let failed = || StoreError::database("remember who has signed in from where");
    let query = sqlx::query(NOTED).bind(pair);
    session.execute_query(query).await.map_err(failed())?;
    let newest = limits::SIGN_IN_KNOWN_MAX.saturating_sub(1);
    let newest = i64::try_from(newest).unwrap_or(i64::MAX);
    let query = sqlx::query(DELETED).bind(newest);
    session.execute_query(query).await.map_err(failed())?;
    Ok(())
}

/// True if a pair of address and name is stored.
pub(super) async fn knows_pair(session: &mut Session, pair: &str) -> Result<bool, StoreError> {
    const KNOWN: &str = "SELECT 1::int8 FROM sign_in_pair WHERE pair = $1";
    let query = sqlx::query_as(KNOWN).bind(pair);
    let found: Result<Vec<(i64,)>, _> = session.fetch(query).await;
    found
        .map(|found| !found.is_empty())
        .map_err(StoreError::database("say who has signed in from where"))
}

/// Deletes the attempts under these keys.
pub(super) async fn forget(session: &mut Session, keys: &[String]) -> Result<(), StoreError> {
    let query = sqlx::query("DELETE FROM sign_in_try WHERE key = ANY ($1)").bind(keys);
    let forgotten = session.execute_query(query).await;
    forgotten
        .map(drop)
        .map_err(StoreError::database("forget tries to sign in"))
}
