//! First look of an instance at the histories of robots that it has begun to estimate.

use fleetcal_model::WallTime;
use fleetcal_store::{EventKind, EventSource, StoreError};

use crate::connection::Session;

/// Records the start in the histories of those robots whose estimators continue from a stored
/// state.
///
/// # Errors
/// The database's failure.
pub(crate) async fn note_start(
    session: &mut Session,
    robots: &[(i64, WallTime)],
) -> Result<(), StoreError> {
    const STARTED: &str = "
        INSERT INTO robot_event (robot, kind, stamp_ns, received_ns, source)
        SELECT c.robot, $1, c.stamp_ns, s.now, $2
        FROM unnest($3::int8[], $4::int8[]) AS s (robot, now) JOIN checkpoint AS c USING (robot)";
    let (robots, times): (Vec<i64>, Vec<i64>) =
        robots.iter().map(|(robot, now)| (*robot, now.0)).unzip();
    let query = sqlx::query(STARTED)
        .bind(EventKind::ServiceStarted.as_str())
        .bind(EventSource::Service.as_str())
        .bind(robots)
        .bind(times);
    let noted = session.execute_query(query).await;
    noted
        .map(drop)
        .map_err(StoreError::database("note the service's start"))
}
