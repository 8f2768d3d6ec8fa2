//! Snapshot of the cluster's rows at one moment.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use fleetcal_cluster::{
    ClaimId, Duty, DutyOwnership, Epoch, Hearing, Incarnation, Member, Ownership, Seat, Snapshot,
};
use fleetcal_domain::limits;
use fleetcal_model::{RobotId, WallTime};
use fleetcal_store::StoreError;
use fleetcal_store::cluster::{Look, RowsVersion};
use sqlx::FromRow;

use super::robots::robot;
use super::seat::{instance, ns};
use crate::connection::Session;

/// Reads instances, robots and duties, in one transaction.
pub(super) async fn look(session: &mut Session) -> Result<Look, StoreError> {
    let mut look = glance(session).await?;
    look.snapshot.robots = robots(session).await?;
    look.snapshot.duties = duties(session).await?;
    look.is_whole = true;
    Ok(look)
}

/// Reads the instances and the version of the rows, in a single statement if there are any.
pub(super) async fn glance(session: &mut Session) -> Result<Look, StoreError> {
    const GLANCE: &str = "
        SELECT v.version, clock_ns() AS now_ns, i.id, i.incarnation, i.capacity, i.draining, i.linked, i.url,
            i.unheard_instances, i.heard_robots, i.unheard_robots, i.program, i.checkpoint_format, i.config_sha256, i.clock_ahead_ns, i.joined_ns, CASE
                WHEN i.ended_ns IS NULL THEN greatest(i.lease_ends_ns - clock_ns(), 0) ELSE 0
            END AS lease_left_ns, i.ended_ns IS NOT NULL AS is_ended
        FROM cluster_rows AS v CROSS JOIN instance AS i
        WHERE i.ended_ns IS NULL OR i.ended_ns > clock_ns() - $1 ORDER BY i.id";
    let query = sqlx::query_as(GLANCE).bind(ns(limits::CLUSTER_DEAD_SHOWN_FOR));
    let rows: Vec<MemberRow> = session
        .fetch(query)
        .await
        .map_err(StoreError::database("read the instances"))?;
    let (version, now) = match rows.first() {
        Some(row) => (row.version, row.now_ns),
        None => version(session).await?,
    };
    let members = rows.into_iter().map(member).collect::<Result<_, _>>()?;
    Ok(Look {
        version: RowsVersion(version),
        snapshot: Snapshot {
            now: WallTime(now),
            members,
            ..Snapshot::default()
        },
        is_whole: false,
    })
}

/// Reads the version of the rows and the database's clock.
async fn version(session: &mut Session) -> Result<(i64, i64), StoreError> {
    let query = sqlx::query_as("SELECT version, clock_ns() FROM cluster_rows");
    let found: Vec<(i64, i64)> = session
        .fetch(query)
        .await
        .map_err(StoreError::database("read the cluster's version"))?;
    Ok(found.first().copied().unwrap_or_default())
}

#[derive(FromRow)]
struct MemberRow {
    /// Version of all rows.
    version: i64,
    /// Time by the database's clock, ns.
    now_ns: i64,
    id: String,
    incarnation: i64,
    lease_left_ns: i64,
    is_ended: bool,
    capacity: i64,
    draining: bool,
    linked: bool,
    unheard_instances: Vec<String>,
    heard_robots: Vec<String>,
    unheard_robots: Vec<String>,
    url: String,
    program: String,
    checkpoint_format: i64,
    config_sha256: Vec<u8>,
    clock_ahead_ns: i64,
    joined_ns: i64,
}

fn member(row: MemberRow) -> Result<Member, StoreError> {
    let robots = |names: &[String]| -> Result<BTreeSet<RobotId>, StoreError> {
        names.iter().map(|name| robot(name)).collect()
    };
    let instances = row.unheard_instances.iter().map(|name| instance(name));
    let hearing = Hearing {
        unheard_instances: instances.collect::<Result<_, _>>()?,
        heard_robots: robots(&row.heard_robots)?,
        unheard_robots: robots(&row.unheard_robots)?,
    };
    Ok(Member {
        seat: Seat {
            instance: instance(&row.id)?,
            incarnation: Incarnation(row.incarnation),
        },
        lease_left: Duration::from_nanos(row.lease_left_ns.unsigned_abs()),
        is_ended: row.is_ended,
        capacity: u32::try_from(row.capacity).unwrap_or(1),
        draining: row.draining,
        linked: row.linked,
        hearing,
        url: row.url,
        program: row.program,
        checkpoint_format: row.checkpoint_format,
        config_sha256: row.config_sha256,
        clock_ahead_ns: row.clock_ahead_ns,
        joined_ns: row.joined_ns,
    })
}

#[derive(FromRow)]
struct RobotRow {
    id: String,
    instance: Option<String>,
    incarnation: Option<i64>,
    epoch: i64,
    claim: i64,
    heir: Option<String>,
    heir_incarnation: Option<i64>,
    heir_ready_ns: Option<i64>,
    free_since_ns: Option<i64>,
    format: i64,
}

async fn robots(session: &mut Session) -> Result<BTreeMap<RobotId, Ownership>, StoreError> {
    const ROBOTS: &str = "
        SELECT r.id, o.instance, o.incarnation, o.epoch, o.claim, o.heir, o.heir_incarnation,
            o.heir_ready_ns, o.free_since_ns, coalesce(c.format, 0) AS format
        FROM robot_owner AS o JOIN robot AS r ON r.key = o.robot
        LEFT JOIN checkpoint AS c ON c.robot = o.robot";
    let rows: Vec<RobotRow> = session
        .fetch(sqlx::query_as(ROBOTS))
        .await
        .map_err(StoreError::database("read who estimates which robot"))?;
    let owned = rows.into_iter().map(|row| {
        let ownership = Ownership {
            owner: seat(row.instance, row.incarnation)?,
            epoch: Epoch(row.epoch),
            claim: ClaimId(row.claim),
            heir: seat(row.heir, row.heir_incarnation)?,
            heir_ready: row.heir_ready_ns.map(WallTime),
            free_since: row.free_since_ns.map(WallTime),
            checkpoint_format: row.format,
        };
        Ok((robot(&row.id)?, ownership))
    });
    owned.collect()
}

async fn duties(session: &mut Session) -> Result<BTreeMap<Duty, DutyOwnership>, StoreError> {
    type Row = (String, Option<String>, Option<i64>, Option<i64>);
    let query = sqlx::query_as("SELECT name, instance, incarnation, free_since_ns FROM duty");
    let rows: Vec<Row> = session
        .fetch(query)
        .await
        .map_err(StoreError::database("read who has which duty"))?;
    // A newer program may have more of them.
    let known = rows
        .into_iter()
        .filter_map(|row| Some((Duty::parse(&row.0)?, row)));
    let owned = known.map(|(duty, (_, instance, incarnation, free_since_ns))| {
        let ownership = DutyOwnership {
            owner: seat(instance, incarnation)?,
            free_since: free_since_ns.map(WallTime),
        };
        Ok((duty, ownership))
    });
    owned.collect()
}

fn seat(name: Option<String>, incarnation: Option<i64>) -> Result<Option<Seat>, StoreError> {
    let Some((name, incarnation)) = name.zip(incarnation) else {
        return Ok(None);
    };
    Ok(Some(Seat {
        instance: instance(&name)?,
        incarnation: Incarnation(incarnation),
    }))
}
