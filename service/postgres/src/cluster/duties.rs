//! Duties of an instance: how they come and go.

use fleetcal_cluster::{Duty, Seat};
use fleetcal_store::StoreError;

use super::seat;
use crate::connection::Session;

/// Claims free duties; returns those that it got.
pub(super) async fn claim(
    session: &mut Session,
    seat: &Seat,
    duties: &[Duty],
) -> Result<Vec<Duty>, StoreError> {
    const CLAIMED: &str = "
        WITH free AS (
            SELECT name FROM duty WHERE instance IS NULL AND name = ANY ($3)
            ORDER BY name FOR UPDATE SKIP LOCKED
        )
        UPDATE duty AS d SET instance = $1, incarnation = $2, free_since_ns = NULL
        FROM free WHERE d.name = free.name RETURNING d.name";
    if !seat::hold(session, seat).await? {
        return Ok(Vec::new());
    }
    let query = sqlx::query_as(CLAIMED)
        .bind(seat.instance.as_str())
        .bind(seat.incarnation.0)
        .bind(names(duties));
    let claimed: Vec<(String,)> = session
        .fetch(query)
        .await
        .map_err(StoreError::database("claim duties"))?;
    let claimed = claimed.iter();
    Ok(claimed.filter_map(|(name,)| Duty::parse(name)).collect())
}

/// Frees own duties.
pub(super) async fn free(
    session: &mut Session,
    seat: &Seat,
    duties: &[Duty],
) -> Result<(), StoreError> {
    const FREED: &str = "
        UPDATE duty SET instance = NULL, incarnation = NULL, free_since_ns = clock_ns()
        WHERE instance = $1 AND incarnation = $2 AND name = ANY ($3)";
    let query = sqlx::query(FREED)
        .bind(seat.instance.as_str())
        .bind(seat.incarnation.0)
        .bind(names(duties));
    let freed = session.execute_query(query).await;
    freed.map(drop).map_err(StoreError::database("free duties"))
}

fn names(duties: &[Duty]) -> Vec<&'static str> {
    duties.iter().map(|duty| duty.name()).collect()
}
