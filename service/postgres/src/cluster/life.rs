//! Life of an instance: its begin, renewal and end.

use std::collections::BTreeSet;

use fleetcal_cluster::{Incarnation, InstanceId, Seat};
use fleetcal_domain::limits;
use fleetcal_model::{RobotId, WallTime};
use fleetcal_store::StoreError;
use fleetcal_store::cluster::{Joining, Renewal, TakeForDead};

use super::seat::{self, columns, lease_ns, ns};
use crate::advisory::NAME;
use crate::connection::Session;

/// Begins a life of an instance, whose name is locked by the caller's connection.
pub(super) async fn join(
    session: &mut Session,
    joining: &Joining,
    database: &str,
) -> Result<Seat, StoreError> {
    // By the clock as well: a row that is deleted must not give its numbers again.
    const JOINED: &str = "
        INSERT INTO instance AS i (id, incarnation, lease_ends_ns, joined_ns, url, capacity, program,
            checkpoint_format, config_sha256)
        VALUES ($1, clock_ns() / 1000000, clock_ns() + $2, clock_ns(), $3, $4, $5, $6, $7)
        ON CONFLICT (id) DO UPDATE SET
            incarnation = greatest(i.incarnation + 1, excluded.incarnation),
            lease_ends_ns = excluded.lease_ends_ns, ended_ns = NULL,
            joined_ns = excluded.joined_ns, url = excluded.url, capacity = excluded.capacity,
            draining = false, linked = false, program = excluded.program,
            checkpoint_format = excluded.checkpoint_format,
            config_sha256 = excluded.config_sha256, clock_ahead_ns = 0,
            unheard_instances = '{}', heard_robots = '{}', unheard_robots = '{}'
        RETURNING i.incarnation";
    agree_on_key(session, joining, database).await?;
    if let Some(former) = lock_former(session, &joining.instance).await? {
        seat::release(session, &[former]).await?;
    }
    let query = sqlx::query_as(JOINED)
        .bind(joining.instance.as_str())
        .bind(lease_ns())
        .bind(joining.url.as_str())
        .bind(i64::from(joining.capacity))
        .bind(joining.program.as_str())
        .bind(joining.checkpoint_format)
        .bind(joining.config_sha256.as_slice());
    let joined: Vec<(i64,)> = session
        .fetch(query)
        .await
        .map_err(StoreError::database("take an instance in"))?;
    let incarnation = joined.first().map(|(number,)| Incarnation(*number));
    Ok(Seat {
        instance: joining.instance.clone(),
        incarnation: incarnation.ok_or(StoreError::Closed)?,
    })
}

/// Stores the signing key unless there is one that it does not replace, and checks that it agrees.
async fn agree_on_key(
    session: &mut Session,
    joining: &Joining,
    database: &str,
) -> Result<(), StoreError> {
    const FOLLOWED: &str = "UPDATE cluster_key SET signing_key = $1 WHERE signing_key = ANY ($2)";
    let key = joining.signing_key.as_str();
    let failed = || StoreError::database("say what its instances sign with");
    let first = "INSERT INTO cluster_key (id, signing_key) VALUES (1, $1) ON CONFLICT DO NOTHING";
    let added = session.execute_query(sqlx::query(first).bind(key)).await;
    added.map_err(failed())?;
    let followed = sqlx::query(FOLLOWED).bind(key);
    let followed = followed.bind(joining.former_signing_keys.as_slice());
    session.execute_query(followed).await.map_err(failed())?;
    let found: Vec<(String,)> = session
        .fetch(sqlx::query_as("SELECT signing_key FROM cluster_key"))
        .await
        .map_err(failed())?;
    match found.first() {
        Some((found,)) if found != key => Err(StoreError::Server {
            database: database.to_owned(),
            reason: format!(
                "has instances that sign with another key: got {key}, expected {found}; give this \
                 one the key file of the others"
            ),
        }),
        _ => Ok(()),
    }
}

/// Waits until all writes in an earlier life of an instance have ended; returns that life.
async fn lock_former(
    session: &mut Session,
    instance: &InstanceId,
) -> Result<Option<Seat>, StoreError> {
    let query = sqlx::query_as("SELECT incarnation FROM instance WHERE id = $1 FOR UPDATE");
    let found: Vec<(i64,)> = session
        .fetch(query.bind(instance.as_str()))
        .await
        .map_err(StoreError::database("lock an instance"))?;
    Ok(found.first().map(|(number,)| Seat {
        instance: instance.clone(),
        incarnation: Incarnation(*number),
    }))
}

/// Renews a lease; returns the database's time and the least number in an order that it assigns
/// now, or `None` if the seat has ended.
pub(super) async fn renew(
    session: &mut Session,
    seat: &Seat,
    renewal: Renewal,
) -> Result<Option<(WallTime, i64)>, StoreError> {
    const RENEWED: &str = "
        UPDATE instance SET lease_ends_ns = clock_ns() + $3, linked = $4, draining = $5,
            clock_ahead_ns = $6, unheard_instances = $7, heard_robots = $8, unheard_robots = $9
        WHERE id = $1 AND incarnation = $2 AND ended_ns IS NULL
        RETURNING clock_ns(), order_floor()";
    let query = sqlx::query_as(RENEWED)
        .bind(seat.instance.as_str())
        .bind(seat.incarnation.0)
        .bind(lease_ns())
        .bind(renewal.linked)
        .bind(renewal.draining)
        .bind(renewal.clock_ahead_ns)
        .bind(texts(
            &renewal.hearing.unheard_instances,
            InstanceId::as_str,
        ))
        .bind(texts(&renewal.hearing.heard_robots, RobotId::as_str))
        .bind(texts(&renewal.hearing.unheard_robots, RobotId::as_str));
    let renewed: Vec<(i64, i64)> = session
        .fetch(query)
        .await
        .map_err(StoreError::database("renew a lease"))?;
    Ok(renewed.first().map(|(now, floor)| (WallTime(*now), *floor)))
}

fn texts<T>(all: &BTreeSet<T>, text: fn(&T) -> &str) -> Vec<String> {
    all.iter().map(|one| text(one).to_owned()).collect()
}

/// Raises the epochs of own robots above those that a promotion of the database has forgotten:
/// others may have received a higher one than the rows show.
pub(super) async fn raise_epochs(session: &mut Session, seat: &Seat) -> Result<(), StoreError> {
    const RAISED: &str = "
        UPDATE robot_owner SET epoch = order_floor()
        WHERE instance = $1 AND incarnation = $2 AND epoch < order_floor()";
    let query = sqlx::query(RAISED)
        .bind(seat.instance.as_str())
        .bind(seat.incarnation.0);
    let raised = session.execute_query(query).await;
    raised
        .map(drop)
        .map_err(StoreError::database("raise epochs"))
}

/// Ends seats of others and frees their robots and duties; returns the ended seats.
pub(super) async fn take_for_dead(
    session: &mut Session,
    by: &Seat,
    which: TakeForDead<'_>,
) -> Result<Vec<Seat>, StoreError> {
    if !has_lease(session, by).await? {
        return Ok(Vec::new());
    }
    let dead = match which {
        TakeForDead::LeaseEnded => {
            const ENDED: &str = "
                SELECT id, incarnation FROM instance
                WHERE id <> $1 AND ended_ns IS NULL AND lease_ends_ns <= clock_ns()
                ORDER BY id FOR UPDATE";
            sqlx::query_as(ENDED).bind(by.instance.as_str())
        }
        TakeForDead::Gone(instances) => {
            const GONE: &str = "
                SELECT id, incarnation FROM instance
                WHERE id <> $1 AND ended_ns IS NULL AND id = ANY ($2) ORDER BY id FOR UPDATE";
            let gone = without_connection(session, instances).await?;
            sqlx::query_as(GONE).bind(by.instance.as_str()).bind(gone)
        }
    };
    let dead: Vec<(String, i64)> = session
        .fetch(dead)
        .await
        .map_err(StoreError::database("lock instances"))?;
    let seats = dead.iter().map(|(name, number)| {
        Ok(Seat {
            instance: seat::instance(name)?,
            incarnation: Incarnation(*number),
        })
    });
    let seats: Vec<Seat> = seats.collect::<Result<_, StoreError>>()?;
    if !seats.is_empty() {
        end(session, &seats).await?;
        seat::release(session, &seats).await?;
    }
    Ok(seats)
}

/// True if a seat's lease has not ended.
async fn has_lease(session: &mut Session, seat: &Seat) -> Result<bool, StoreError> {
    const LIVES: &str = "SELECT 1::int8 FROM instance WHERE id = $1 AND incarnation = $2
        AND ended_ns IS NULL AND lease_ends_ns > clock_ns()";
    let query = sqlx::query_as(LIVES)
        .bind(seat.instance.as_str())
        .bind(seat.incarnation.0);
    let found: Vec<(i64,)> = session
        .fetch(query)
        .await
        .map_err(StoreError::database("read a lease"))?;
    Ok(!found.is_empty())
}

/// Returns the instances whose connection does not hold the lock of their name. The lock is held
/// here until the transaction ends, so that none returns meanwhile.
async fn without_connection(
    session: &mut Session,
    instances: &[InstanceId],
) -> Result<Vec<String>, StoreError> {
    let names: Vec<&str> = instances.iter().map(InstanceId::as_str).collect();
    let asked = format!(
        "SELECT name FROM unnest($1::text[]) AS n (name)
         WHERE pg_try_advisory_xact_lock({NAME}, hashtext(name))"
    );
    let query = sqlx::query_as(sqlx::AssertSqlSafe(asked)).bind(names);
    let found: Vec<(String,)> = session
        .fetch(query)
        .await
        .map_err(StoreError::database("say which instances are connected"))?;
    Ok(found.into_iter().map(|(name,)| name).collect())
}

/// Ends lives, whose rows are locked, and forgets those that ended long ago.
async fn end(session: &mut Session, seats: &[Seat]) -> Result<(), StoreError> {
    const ENDED: &str = "
        UPDATE instance AS i SET incarnation = i.incarnation + 1, ended_ns = clock_ns(),
            lease_ends_ns = least(i.lease_ends_ns, clock_ns())
        FROM unnest($1::text[], $2::int8[]) AS s (id, incarnation)
        WHERE i.id = s.id AND i.incarnation = s.incarnation";
    const FORGOTTEN: &str = "DELETE FROM instance WHERE ended_ns < clock_ns() - $1";
    let failed = || StoreError::database("take an instance for dead");
    let (instances, incarnations) = columns(seats);
    let query = sqlx::query(ENDED).bind(instances).bind(incarnations);
    session.execute_query(query).await.map_err(failed())?;
    let query = sqlx::query(FORGOTTEN).bind(ns(limits::CLUSTER_DEAD_SHOWN_FOR));
    session.execute_query(query).await.map_err(failed())?;
    Ok(())
}

/// Ends a life at the request of its own process, and frees its robots and duties.
pub(super) async fn leave(session: &mut Session, seat: &Seat) -> Result<(), StoreError> {
    if !seat::stop_writes(session, seat).await? {
        return Ok(());
    }
    seat::release(session, std::slice::from_ref(seat)).await?;
    let query = sqlx::query("DELETE FROM instance WHERE id = $1").bind(seat.instance.as_str());
    let left = session.execute_query(query).await;
    left.map(drop)
        .map_err(StoreError::database("let an instance go"))
}
