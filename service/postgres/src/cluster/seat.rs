//! Seat of an instance, and the proof that it is still its own.

use fleetcal_cluster::{InstanceId, Seat};
use fleetcal_domain::limits;
use fleetcal_store::StoreError;

use crate::connection::Session;

/// Keeps a life of an instance from being ended until the transaction ends; returns `false` if it
/// has ended before.
pub(super) async fn hold(session: &mut Session, seat: &Seat) -> Result<bool, StoreError> {
    const HELD: &str = "SELECT 1::int8 FROM instance
        WHERE id = $1 AND incarnation = $2 AND ended_ns IS NULL FOR KEY SHARE";
    lock(session, HELD, seat).await
}

/// Waits until all writes in a life of an instance have ended, and blocks such writes until the
/// transaction ends; returns `false` if the life has ended before.
pub(super) async fn stop_writes(session: &mut Session, seat: &Seat) -> Result<bool, StoreError> {
    const STOPPED: &str = "SELECT 1::int8 FROM instance
        WHERE id = $1 AND incarnation = $2 AND ended_ns IS NULL FOR UPDATE";
    lock(session, STOPPED, seat).await
}

async fn lock(session: &mut Session, sql: &'static str, seat: &Seat) -> Result<bool, StoreError> {
    let found: Vec<(i64,)> = session
        .fetch(
            sqlx::query_as(sql)
                .bind(seat.instance.as_str())
                .bind(seat.incarnation.0),
        )
        .await
        .map_err(StoreError::database("lock an instance"))?;
    Ok(!found.is_empty())
}

/// Frees the robots and duties of ended seats, and those that they were heirs of.
pub(super) async fn release(session: &mut Session, seats: &[Seat]) -> Result<(), StoreError> {
    const ROBOTS: &str = "
        WITH freed AS (
            SELECT o.robot FROM robot_owner AS o
            JOIN unnest($1::text[], $2::int8[]) AS s (instance, incarnation)
                USING (instance, incarnation)
            ORDER BY o.robot FOR UPDATE OF o
        )
        UPDATE robot_owner AS o SET instance = NULL, incarnation = NULL, heir = NULL,
            heir_incarnation = NULL, heir_ready_ns = NULL, free_since_ns = clock_ns()
        FROM freed WHERE o.robot = freed.robot";
    const HEIRS: &str = "
        WITH named AS (
            SELECT o.robot FROM robot_owner AS o
            JOIN unnest($1::text[], $2::int8[]) AS s (heir, heir_incarnation)
                USING (heir, heir_incarnation)
            ORDER BY o.robot FOR UPDATE OF o
        )
        UPDATE robot_owner AS o SET heir = NULL, heir_incarnation = NULL, heir_ready_ns = NULL
        FROM named WHERE o.robot = named.robot";
    const DUTIES: &str = "
        UPDATE duty AS d SET instance = NULL, incarnation = NULL, free_since_ns = clock_ns()
        FROM unnest($1::text[], $2::int8[]) AS s (instance, incarnation)
        WHERE d.instance = s.instance AND d.incarnation = s.incarnation";
    let (instances, incarnations) = columns(seats);
    for sql in [ROBOTS, HEIRS, DUTIES] {
        let query = sqlx::query(sql).bind(&instances).bind(&incarnations);
        let freed = session.execute_query(query).await;
        freed.map_err(StoreError::database("free what an instance had"))?;
    }
    Ok(())
}

/// Returns names and incarnations of seats, as arrays.
pub(super) fn columns<'s>(seats: impl IntoIterator<Item = &'s Seat>) -> (Vec<String>, Vec<i64>) {
    let seats = seats.into_iter();
    let of = |seat: &Seat| (seat.instance.as_str().to_owned(), seat.incarnation.0);
    seats.map(of).unzip()
}

/// Parses the name of an instance from a row.
pub(super) fn instance(name: &str) -> Result<InstanceId, StoreError> {
    InstanceId::parse(name).map_err(|error| StoreError::Corrupt {
        table: "instance",
        reason: error.to_string(),
    })
}

/// Converts a span of time into the database's unit, ns.
pub(super) fn ns(span: std::time::Duration) -> i64 {
    i64::try_from(span.as_nanos()).unwrap_or(i64::MAX)
}

/// Returns the length of a lease, ns.
pub(super) fn lease_ns() -> i64 {
    ns(limits::CLUSTER_LEASE)
}
