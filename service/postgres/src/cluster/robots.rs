//! Claims and releases of an instance's robots.

use fleetcal_cluster::{ClaimId, Epoch, Seat, Tenure};
use fleetcal_model::RobotId;
use fleetcal_sql::StatementError;
use fleetcal_store::StoreError;
use sqlx::Postgres;
use sqlx::postgres::PgArguments;

use super::seat::{self, columns};
use crate::connection::Session;

type Query = sqlx::query::Query<'static, Postgres, PgArguments>;

/// Claims free robots whose state the instance can read.
pub(super) async fn claim(
    session: &mut Session,
    seat: &Seat,
    robots: &[(RobotId, ClaimId)],
) -> Result<Vec<Tenure>, StoreError> {
    const CLAIMED: &str = "
        WITH free AS (
            SELECT o.robot, r.id, w.claim
            FROM unnest($3::text[], $4::int8[]) AS w (id, claim)
            JOIN robot AS r USING (id) JOIN robot_owner AS o ON o.robot = r.key
            LEFT JOIN checkpoint AS c ON c.robot = o.robot
            WHERE o.instance IS NULL
                AND coalesce(c.format, 0) <= (SELECT checkpoint_format FROM instance WHERE id = $1)
            ORDER BY o.robot FOR UPDATE OF o SKIP LOCKED
        )
        UPDATE robot_owner AS o SET instance = $1, incarnation = $2,
            epoch = greatest(o.epoch + 1, (SELECT order_floor())), claim = free.claim, heir = NULL,
            heir_incarnation = NULL, heir_ready_ns = NULL, free_since_ns = NULL
        FROM free WHERE o.robot = free.robot RETURNING free.id, o.epoch, o.claim";
    if !seat::hold(session, seat).await? {
        return Ok(Vec::new());
    }
    let claims: Vec<i64> = robots.iter().map(|(_, claim)| claim.0).collect();
    let query = sqlx::query_as(CLAIMED)
        .bind(seat.instance.as_str())
        .bind(seat.incarnation.0)
        .bind(names(robots.iter().map(|(robot, _)| robot)))
        .bind(claims);
    let claimed: Vec<(String, i64, i64)> = session
        .fetch(query)
        .await
        .map_err(StoreError::database("claim robots"))?;
    let tenures = claimed.iter().map(|(name, epoch, claim)| {
        Ok(Tenure {
            robot: robot(name)?,
            seat: seat.clone(),
            epoch: Epoch(*epoch),
            claim: ClaimId(*claim),
        })
    });
    tenures.collect()
}

/// Names the heirs of own robots. An heir that is named already stays as ready as it is.
pub(super) async fn name_heirs(
    session: &mut Session,
    seat: &Seat,
    robots: &[(RobotId, Option<Seat>)],
) -> Result<(), StoreError> {
    const NAMED: &str = "
        WITH own AS (
            SELECT o.robot, n.heir, n.heir_incarnation
            FROM unnest($3::text[], $4::text[], $5::int8[]) AS n (id, heir, heir_incarnation)
            JOIN robot AS r USING (id) JOIN robot_owner AS o ON o.robot = r.key
            WHERE o.instance = $1 AND o.incarnation = $2
                AND (o.heir, o.heir_incarnation) IS DISTINCT FROM (n.heir, n.heir_incarnation)
            ORDER BY o.robot FOR UPDATE OF o
        )
        UPDATE robot_owner AS o SET heir = own.heir, heir_incarnation = own.heir_incarnation,
            heir_ready_ns = NULL
        FROM own WHERE o.robot = own.robot";
    let heirs = robots.iter().map(|(_, heir)| heir.as_ref());
    let (heirs, incarnations): (Vec<Option<String>>, Vec<Option<i64>>) = heirs
        .map(|heir| {
            let name = heir.map(|heir| heir.instance.as_str().to_owned());
            (name, heir.map(|heir| heir.incarnation.0))
        })
        .unzip();
    let query = sqlx::query(NAMED)
        .bind(seat.instance.as_str().to_owned())
        .bind(seat.incarnation.0)
        .bind(names(robots.iter().map(|(robot, _)| robot)))
        .bind(heirs)
        .bind(incarnations);
    let held = seat::hold(session, seat).await?;
    change(session, held, query, StoreError::database("name heirs")).await
}

/// Records that the seat receives the messages of robots that it is the heir of.
pub(super) async fn note_ready(
    session: &mut Session,
    seat: &Seat,
    robots: &[RobotId],
) -> Result<(), StoreError> {
    const READY: &str = "
        WITH heard AS (
            SELECT o.robot FROM robot_owner AS o JOIN robot AS r ON r.key = o.robot
            WHERE o.heir = $1 AND o.heir_incarnation = $2 AND o.heir_ready_ns IS NULL
                AND r.id = ANY ($3)
            ORDER BY o.robot FOR UPDATE OF o
        )
        UPDATE robot_owner AS o SET heir_ready_ns = clock_ns()
        FROM heard WHERE o.robot = heard.robot";
    let query = of_robots(READY, seat, robots);
    let held = seat::hold(session, seat).await?;
    change(session, held, query, StoreError::database("note an heir")).await
}

/// Hands own robots over to their heirs, if these are alive; returns the robots that were handed
/// over.
pub(super) async fn hand_over(
    session: &mut Session,
    seat: &Seat,
    robots: &[(RobotId, Seat, ClaimId)],
) -> Result<Vec<RobotId>, StoreError> {
    // Nobody takes an heir for dead behind what it is just given.
    const HEIRS: &str = "
        SELECT i.id FROM instance AS i
        JOIN unnest($1::text[], $2::int8[]) AS h (id, incarnation) USING (id, incarnation)
        WHERE i.ended_ns IS NULL AND i.lease_ends_ns > clock_ns()
        ORDER BY i.id FOR KEY SHARE OF i";
    const HANDED: &str = "
        WITH own AS (
            SELECT o.robot, r.id, w.heir, w.heir_incarnation, w.claim
            FROM unnest($3::text[], $4::text[], $5::int8[], $6::int8[])
                AS w (id, heir, heir_incarnation, claim)
            JOIN robot AS r USING (id) JOIN robot_owner AS o ON o.robot = r.key
            WHERE o.instance = $1 AND o.incarnation = $2 AND w.heir = ANY ($7)
                AND o.heir = w.heir AND o.heir_incarnation = w.heir_incarnation
            ORDER BY o.robot FOR UPDATE OF o
        )
        UPDATE robot_owner AS o SET instance = own.heir, incarnation = own.heir_incarnation,
            epoch = greatest(o.epoch + 1, (SELECT order_floor())), claim = own.claim, heir = NULL,
            heir_incarnation = NULL, heir_ready_ns = NULL
        FROM own WHERE o.robot = own.robot RETURNING own.id";
    if !seat::stop_writes(session, seat).await? {
        return Ok(Vec::new());
    }
    let (heirs, incarnations) = columns(robots.iter().map(|(_, heir, _)| heir));
    let query = sqlx::query_as(HEIRS)
        .bind(heirs.clone())
        .bind(incarnations.clone());
    let live: Vec<(String,)> = session
        .fetch(query)
        .await
        .map_err(StoreError::database("lock heirs"))?;
    let live: Vec<String> = live.into_iter().map(|(name,)| name).collect();
    let claims: Vec<i64> = robots.iter().map(|(_, _, claim)| claim.0).collect();
    let query = sqlx::query_as(HANDED)
        .bind(seat.instance.as_str())
        .bind(seat.incarnation.0)
        .bind(names(robots.iter().map(|(robot, ..)| robot)))
        .bind(heirs)
        .bind(incarnations)
        .bind(claims)
        .bind(live);
    let handed: Vec<(String,)> = session
        .fetch(query)
        .await
        .map_err(StoreError::database("hand robots over"))?;
    handed.iter().map(|(name,)| robot(name)).collect()
}

/// Frees own robots.
pub(super) async fn free(
    session: &mut Session,
    seat: &Seat,
    robots: &[RobotId],
) -> Result<(), StoreError> {
    const FREED: &str = "
        WITH own AS (
            SELECT o.robot FROM robot_owner AS o JOIN robot AS r ON r.key = o.robot
            WHERE o.instance = $1 AND o.incarnation = $2 AND r.id = ANY ($3)
            ORDER BY o.robot FOR UPDATE OF o
        )
        UPDATE robot_owner AS o SET instance = NULL, incarnation = NULL, heir = NULL,
            heir_incarnation = NULL, heir_ready_ns = NULL, free_since_ns = clock_ns()
        FROM own WHERE o.robot = own.robot";
    let query = of_robots(FREED, seat, robots);
    let held = seat::stop_writes(session, seat).await?;
    change(session, held, query, StoreError::database("free robots")).await
}

/// Runs a statement if the seat is `held`.
async fn change(
    session: &mut Session,
    held: bool,
    query: Query,
    failed: impl FnOnce(StatementError) -> StoreError,
) -> Result<(), StoreError> {
    if held {
        session.execute_query(query).await.map_err(failed)?;
    }
    Ok(())
}

/// Makes a statement whose values are a seat and robots.
fn of_robots(sql: &'static str, seat: &Seat, robots: &[RobotId]) -> Query {
    sqlx::query(sql)
        .bind(seat.instance.as_str().to_owned())
        .bind(seat.incarnation.0)
        .bind(names(robots))
}

pub(super) fn names<'r>(robots: impl IntoIterator<Item = &'r RobotId>) -> Vec<String> {
    let robots = robots.into_iter();
    robots.map(|robot| robot.as_str().to_owned()).collect()
}

/// Parses a robot's id from a row.
pub(super) fn robot(name: &str) -> Result<RobotId, StoreError> {
    RobotId::parse(name).map_err(|error| StoreError::Corrupt {
        table: "robot",
        reason: error.to_string(),
    })
}
