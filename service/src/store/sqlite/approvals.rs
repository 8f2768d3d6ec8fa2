//! The life cycle's records: each decision is read, taken and written in one transaction.

use std::collections::BTreeMap;

use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Envelope;
use serde::Serialize;
use serde::de::DeserializeOwned;
use sqlx::sqlite::{SqliteConnection, SqlitePool, SqliteRow};
use sqlx::{QueryBuilder, Row, Sqlite};

use super::audit;
use super::read::{column, parsed, robot_id};
use crate::approval::{
    self, Deployment, GenerationRef, NextIds, Outcome, Parcel, Proposal, Refused, Revision,
    RobotLedger, Shadow, Standing,
};
use crate::store::approvals::{
    AuditFilter, AuditRow, Decided, Decision, HoldWrite, ProposalFilter, SiteHold,
};
use crate::store::audit::AuditEntry;
use crate::store::error::StoreError;

const LIVE: &str = "state IN ('queued', 'offered', 'applied', 'verifying', 'rolling_back')";

/// Takes a decision in the transaction that the connection is in.
///
/// # Errors
/// [`StoreError::Refused`] and [`StoreError::KeyReused`] before anything is written.
pub(super) async fn decide(
    connection: &mut SqliteConnection,
    decision: &Decision,
) -> Result<Decided, StoreError> {
    if let Some(proposal) = answered(connection, decision).await? {
        return Ok(Decided::Repeated(Box::new(proposal)));
    }
    let answered = match &decision.command {
        approval::Command::Acknowledge(applied) => Some(applied.generation),
        _ => None,
    };
    let ledger = ledger(connection, &decision.robot, answered).await?;
    let standing = Standing {
        policy: &decision.policy,
        key: &decision.key,
        actor: &decision.actor,
        now_ns: decision.now_ns,
    };
    let ids = next_ids(connection).await?;
    let outcome = match approval::step(&ledger, decision.command.clone(), ids, &standing) {
        Ok(outcome) => outcome,
        Err(refused) => return Err(refused_on(connection, &decision.command, refused).await?),
    };
    write(connection, decision, &outcome).await?;
    Ok(Decided::Taken(Box::new(outcome)))
}

/// Tells "somebody was faster" from "that was decided long ago": a proposal that is not open any
/// more has another version than the one that was looked at while it was.
async fn refused_on(
    connection: &mut SqliteConnection,
    command: &approval::Command,
    refused: Refused,
) -> Result<StoreError, StoreError> {
    let (Refused::NotOpen(id), Some(looked_at)) = (&refused, command.version()) else {
        return Ok(StoreError::Refused(refused));
    };
    let row = sqlx::query("SELECT record FROM proposal WHERE id = ?1")
        .bind(i64::try_from(*id).unwrap_or(i64::MAX))
        .fetch_optional(connection)
        .await
        .map_err(StoreError::database("read a proposal"))?;
    let found: Option<Proposal> = row.map(|row| record(&row, "proposal", 0)).transpose()?;
    Ok(StoreError::Refused(match found {
        Some(found) if found.version != looked_at => Refused::Stale {
            found: found.version,
        },
        Some(found) => Refused::ProposalClosed { state: found.state },
        None => refused,
    }))
}

async fn write(
    connection: &mut SqliteConnection,
    decision: &Decision,
    outcome: &Outcome,
) -> Result<(), StoreError> {
    let robot = decision.robot.as_str();
    for revision in &outcome.revisions {
        put(
            connection,
            "INSERT INTO revision (id, record) VALUES (?1, ?2)",
            revision.id,
            revision,
        )
        .await?;
    }
    for proposal in &outcome.proposals {
        let sql = "INSERT INTO proposal (id, record) VALUES (?1, ?2)
             ON CONFLICT (id) DO UPDATE SET record = excluded.record";
        put(connection, sql, proposal.id, proposal).await?;
    }
    for deployment in &outcome.deployments {
        let sql = "INSERT INTO deployment (id, record) VALUES (?1, ?2)
             ON CONFLICT (id) DO UPDATE SET record = excluded.record";
        put(connection, sql, deployment.id, deployment).await?;
    }
    if outcome.shadow_changed {
        sqlx::query(
            "INSERT INTO shadow (robot, record) VALUES (?1, ?2)
             ON CONFLICT (robot) DO UPDATE SET record = excluded.record",
        )
        .bind(robot)
        .bind(json(&outcome.ledger.shadow)?)
        .execute(&mut *connection)
        .await
        .map_err(StoreError::database("write a robot's shadow"))?;
    }
    for (generation, envelope) in &outcome.envelopes {
        sqlx::query("INSERT INTO envelope (robot, generation, record) VALUES (?1, ?2, ?3)")
            .bind(robot)
            .bind(*generation as i64)
            .bind(json(envelope)?)
            .execute(&mut *connection)
            .await
            .map_err(StoreError::database("write a signed document"))?;
    }
    write_outbox(connection, robot, outcome).await?;
    for entry in decision.audit(outcome) {
        audit::append(connection, &entry).await?;
    }
    remember_answer(connection, decision, outcome).await
}

async fn put<T: Serialize>(
    connection: &mut SqliteConnection,
    sql: &'static str,
    id: u64,
    record: &T,
) -> Result<(), StoreError> {
    sqlx::query(sql)
        .bind(id as i64)
        .bind(json(record)?)
        .execute(connection)
        .await
        .map_err(StoreError::database("write a record of the life cycle"))?;
    Ok(())
}

async fn write_outbox(
    connection: &mut SqliteConnection,
    robot: &str,
    outcome: &Outcome,
) -> Result<(), StoreError> {
    let failed = || StoreError::database("write the outbox");
    if let Some(sent) = outcome.sent {
        let (kind, generation) = columns_of(sent);
        // A newer one of its kind stays.
        sqlx::query("DELETE FROM outbox WHERE robot = ?1 AND kind = ?2 AND generation = ?3")
            .bind(robot)
            .bind(kind)
            .bind(generation)
            .execute(&mut *connection)
            .await
            .map_err(failed())?;
    }
    for parcel in &outcome.parcels {
        let (kind, generation) = columns_of(*parcel);
        sqlx::query(
            "INSERT INTO outbox (robot, kind, generation) VALUES (?1, ?2, ?3)
             ON CONFLICT (robot, kind) DO UPDATE SET generation = excluded.generation",
        )
        .bind(robot)
        .bind(kind)
        .bind(generation)
        .execute(&mut *connection)
        .await
        .map_err(failed())?;
    }
    Ok(())
}

const fn columns_of(parcel: Parcel) -> (&'static str, i64) {
    match parcel {
        Parcel::Approved(generation) => ("approved", generation as i64),
        Parcel::Confirmed(generation) => ("confirmed", generation as i64),
    }
}

/// The proposal with which the same request was answered before.
async fn answered(
    connection: &mut SqliteConnection,
    decision: &Decision,
) -> Result<Option<Proposal>, StoreError> {
    let Some(key) = &decision.idempotency else {
        return Ok(None);
    };
    let row = sqlx::query(
        "SELECT r.request_sha256, p.record FROM proposal_request AS r
         JOIN proposal AS p ON p.id = r.proposal WHERE r.robot = ?1 AND r.key = ?2",
    )
    .bind(decision.robot.as_str())
    .bind(&key.key)
    .fetch_optional(connection)
    .await
    .map_err(StoreError::database("read an answer given before"))?;
    let Some(row) = row else { return Ok(None) };
    let sha256: Vec<u8> = column(&row, "proposal_request", 0)?;
    if sha256 != key.request_sha256 {
        return Err(StoreError::KeyReused);
    }
    record(&row, "proposal", 1).map(Some)
}

async fn remember_answer(
    connection: &mut SqliteConnection,
    decision: &Decision,
    outcome: &Outcome,
) -> Result<(), StoreError> {
    let (Some(key), Some(proposal)) = (&decision.idempotency, outcome.proposals.last()) else {
        return Ok(());
    };
    sqlx::query(
        "INSERT INTO proposal_request (robot, key, request_sha256, proposal, received)
         VALUES (?1, ?2, ?3, ?4, ?5)",
    )
    .bind(decision.robot.as_str())
    .bind(&key.key)
    .bind(key.request_sha256.as_slice())
    .bind(proposal.id as i64)
    .bind(decision.now_ns.div_euclid(1_000_000_000))
    .execute(connection)
    .await
    .map_err(StoreError::database("remember an answer"))?;
    Ok(())
}

async fn next_ids(connection: &mut SqliteConnection) -> Result<NextIds, StoreError> {
    let row = sqlx::query(
        "SELECT (SELECT coalesce(max(id), 0) + 1 FROM revision),
                (SELECT coalesce(max(id), 0) + 1 FROM proposal),
                (SELECT coalesce(max(id), 0) + 1 FROM deployment)",
    )
    .fetch_one(connection)
    .await
    .map_err(StoreError::database("read the next numbers"))?;
    Ok(NextIds {
        revision: number(&row, 0)?,
        proposal: number(&row, 1)?,
        deployment: number(&row, 2)?,
    })
}

/// One robot's records, with the document of the generation that an answer is about.
async fn ledger(
    connection: &mut SqliteConnection,
    robot: &RobotId,
    answered: Option<u64>,
) -> Result<RobotLedger, StoreError> {
    let failed = || StoreError::database("read a robot's records");
    let row = sqlx::query("SELECT record FROM shadow WHERE robot = ?1")
        .bind(robot.as_str())
        .fetch_optional(&mut *connection)
        .await
        .map_err(failed())?;
    let mut ledger = RobotLedger::new(robot.clone());
    if let Some(row) = row {
        ledger.shadow = record(&row, "shadow", 0)?;
    }
    let row = sqlx::query("SELECT record FROM proposal WHERE robot = ?1 AND state = 'proposed'")
        .bind(robot.as_str())
        .fetch_optional(&mut *connection)
        .await
        .map_err(failed())?;
    ledger.open = row.map(|row| record(&row, "proposal", 0)).transpose()?;
    let row = QueryBuilder::<Sqlite>::new("SELECT record FROM deployment WHERE ")
        .push(LIVE)
        .push(" AND robot = ")
        .push_bind(robot.as_str())
        .build()
        .fetch_optional(&mut *connection)
        .await
        .map_err(failed())?;
    ledger.live = row.map(|row| record(&row, "deployment", 0)).transpose()?;
    if let Some(generation) = answered {
        ledger.answered = given_out(connection, robot, generation).await?;
    }
    for id in ledger.named_revisions() {
        let row = sqlx::query("SELECT record FROM revision WHERE id = ?1")
            .bind(id as i64)
            .fetch_one(&mut *connection)
            .await
            .map_err(failed())?;
        ledger.revisions.insert(id, record(&row, "revision", 0)?);
    }
    Ok(ledger)
}

/// What was given out under a generation.
async fn given_out(
    connection: &mut SqliteConnection,
    robot: &RobotId,
    generation: u64,
) -> Result<Option<GenerationRef>, StoreError> {
    let row = sqlx::query(
        "SELECT (record ->> '$.document') ->> '$.revision', record ->> '$.sha256'
         FROM envelope WHERE robot = ?1 AND generation = ?2",
    )
    .bind(robot.as_str())
    .bind(i64::try_from(generation).unwrap_or(i64::MAX))
    .fetch_optional(connection)
    .await
    .map_err(StoreError::database("read what was given out"))?;
    let of = |row: SqliteRow| {
        Ok(GenerationRef {
            generation,
            revision: number(&row, 0)?,
            sha256: column(&row, "envelope", 1)?,
        })
    };
    row.map(of).transpose()
}

/// The records of every robot that has any.
pub(super) async fn ledgers(pool: &SqlitePool) -> Result<Vec<RobotLedger>, StoreError> {
    let failed = || StoreError::database("read the robots' records");
    let mut found: BTreeMap<RobotId, RobotLedger> = BTreeMap::new();
    let rows = sqlx::query("SELECT record FROM shadow")
        .fetch_all(pool)
        .await;
    for row in rows.map_err(failed())? {
        let shadow: Shadow = record(&row, "shadow", 0)?;
        let mut ledger = RobotLedger::new(shadow.robot.clone());
        ledger.shadow = shadow;
        found.insert(ledger.shadow.robot.clone(), ledger);
    }
    let mut of = |robot: &RobotId, take: &mut dyn FnMut(&mut RobotLedger)| {
        let new = || RobotLedger::new(robot.clone());
        take(found.entry(robot.clone()).or_insert_with(new));
    };
    let rows = sqlx::query("SELECT record FROM proposal WHERE state = 'proposed'").fetch_all(pool);
    for row in rows.await.map_err(failed())? {
        let open: Proposal = record(&row, "proposal", 0)?;
        of(&open.robot.clone(), &mut |ledger| {
            ledger.open = Some(open.clone())
        });
    }
    let mut live = QueryBuilder::<Sqlite>::new("SELECT record FROM deployment WHERE ");
    let rows = live.push(LIVE).build().fetch_all(pool).await;
    for row in rows.map_err(failed())? {
        let live: Deployment = record(&row, "deployment", 0)?;
        of(&live.robot.clone(), &mut |ledger| {
            ledger.live = Some(live.clone())
        });
    }
    for ledger in found.values_mut() {
        for id in ledger.named_revisions() {
            let row = sqlx::query("SELECT record FROM revision WHERE id = ?1").bind(id as i64);
            let row = row.fetch_one(pool).await.map_err(failed())?;
            ledger.revisions.insert(id, record(&row, "revision", 0)?);
        }
    }
    Ok(found.into_values().collect())
}

/// A signed document.
pub(super) async fn envelope(
    pool: &SqlitePool,
    robot: &RobotId,
    generation: u64,
) -> Result<Option<Envelope>, StoreError> {
    let row = sqlx::query("SELECT record FROM envelope WHERE robot = ?1 AND generation = ?2")
        .bind(robot.as_str())
        .bind(generation as i64)
        .fetch_optional(pool)
        .await
        .map_err(StoreError::database("read a signed document"))?;
    row.map(|row| record(&row, "envelope", 0)).transpose()
}

/// What waits to be sent.
pub(super) async fn outbox(pool: &SqlitePool) -> Result<Vec<(RobotId, Parcel)>, StoreError> {
    let rows = sqlx::query("SELECT robot, kind, generation FROM outbox ORDER BY robot, kind")
        .fetch_all(pool)
        .await
        .map_err(StoreError::database("read the outbox"))?;
    rows.iter()
        .map(|row| {
            let kind: String = column(row, "outbox", 1)?;
            let generation = number(row, 2)?;
            let parcel = if kind == "approved" {
                Parcel::Approved(generation)
            } else {
                Parcel::Confirmed(generation)
            };
            Ok((robot_id(row, "outbox", 0)?, parcel))
        })
        .collect()
}

/// Proposals with what they propose, newest first.
pub(super) async fn proposals(
    pool: &SqlitePool,
    filter: &ProposalFilter,
) -> Result<Vec<(Proposal, Revision)>, StoreError> {
    let mut query = QueryBuilder::<Sqlite>::new(
        "SELECT p.record, r.record FROM proposal AS p JOIN revision AS r ON r.id = p.revision
         WHERE true",
    );
    if let Some(robot) = &filter.robot {
        query
            .push(" AND p.robot = ")
            .push_bind(robot.as_str().to_owned());
    }
    if let Some(state) = filter.state {
        query.push(" AND p.state = ").push_bind(state.as_str());
    }
    if let Some(before) = filter.before {
        query.push(" AND p.id < ").push_bind(before);
    }
    query
        .push(" ORDER BY p.id DESC LIMIT ")
        .push_bind(i64::from(filter.limit));
    let rows = query.build().fetch_all(pool).await;
    rows.map_err(StoreError::database("read the proposals"))?
        .iter()
        .map(pair)
        .collect()
}

/// One proposal with what it proposes.
pub(super) async fn proposal(
    pool: &SqlitePool,
    id: u64,
) -> Result<Option<(Proposal, Revision)>, StoreError> {
    let row = sqlx::query(
        "SELECT p.record, r.record FROM proposal AS p JOIN revision AS r ON r.id = p.revision
         WHERE p.id = ?1",
    )
    .bind(i64::try_from(id).unwrap_or(i64::MAX))
    .fetch_optional(pool)
    .await
    .map_err(StoreError::database("read a proposal"))?;
    row.as_ref().map(pair).transpose()
}

fn pair(row: &SqliteRow) -> Result<(Proposal, Revision), StoreError> {
    Ok((record(row, "proposal", 0)?, record(row, "revision", 1)?))
}

/// A robot's deployments, newest first.
pub(super) async fn deployments(
    pool: &SqlitePool,
    robot: &RobotId,
    before: Option<i64>,
    limit: u32,
) -> Result<Vec<Deployment>, StoreError> {
    let rows = sqlx::query(
        "SELECT record FROM deployment WHERE robot = ?1 AND id < ?2 ORDER BY id DESC LIMIT ?3",
    )
    .bind(robot.as_str())
    .bind(before.unwrap_or(i64::MAX))
    .bind(i64::from(limit))
    .fetch_all(pool)
    .await
    .map_err(StoreError::database("read a robot's deployments"))?;
    rows.iter()
        .map(|row| record(row, "deployment", 0))
        .collect()
}

/// Holds or releases the site-wide stop.
pub(super) async fn hold(
    connection: &mut SqliteConnection,
    write: &HoldWrite,
) -> Result<SiteHold, StoreError> {
    let failed = || StoreError::database("write the site-wide stop");
    let select = "SELECT version, held, by, at_ns, reason FROM site";
    let row = sqlx::query(select).fetch_one(&mut *connection).await;
    let before = site_of(&row.map_err(failed())?)?;
    if before.version != write.version {
        let found = before.version;
        return Err(StoreError::Refused(Refused::Stale { found }));
    }
    if write.reason.trim().is_empty() {
        return Err(StoreError::Refused(Refused::ReasonMissing));
    }
    let after = SiteHold {
        version: before.version + 1,
        held: write.held,
        by: Some(write.actor.name.clone()),
        at_ns: Some(write.now_ns),
        reason: Some(write.reason.clone()),
    };
    sqlx::query("UPDATE site SET version = ?1, held = ?2, by = ?3, at_ns = ?4, reason = ?5")
        .bind(after.version as i64)
        .bind(after.held)
        .bind(&after.by)
        .bind(after.at_ns)
        .bind(&after.reason)
        .execute(&mut *connection)
        .await
        .map_err(failed())?;
    let entry = AuditEntry {
        at_ns: write.now_ns,
        actor: write.actor.clone(),
        action: if write.held {
            "site.hold"
        } else {
            "site.release"
        },
        subject: "site",
        subject_id: "1".to_owned(),
        robot: None,
        before: serde_json::to_value(&before).ok(),
        after: serde_json::to_value(&after).ok(),
        reason: Some(write.reason.clone()),
    };
    audit::append(connection, &entry).await?;
    Ok(after)
}

/// The site-wide stop.
pub(super) async fn site_hold(pool: &SqlitePool) -> Result<SiteHold, StoreError> {
    let row = sqlx::query("SELECT version, held, by, at_ns, reason FROM site")
        .fetch_one(pool)
        .await
        .map_err(StoreError::database("read the site-wide stop"))?;
    site_of(&row)
}

fn site_of(row: &SqliteRow) -> Result<SiteHold, StoreError> {
    Ok(SiteHold {
        version: number(row, 0)?,
        held: column(row, "site", 1)?,
        by: column(row, "site", 2)?,
        at_ns: column(row, "site", 3)?,
        reason: column(row, "site", 4)?,
    })
}

/// Rows of the audit, newest first.
pub(super) async fn audit_rows(
    pool: &SqlitePool,
    filter: &AuditFilter,
) -> Result<Vec<AuditRow>, StoreError> {
    let mut query = QueryBuilder::<Sqlite>::new(
        "SELECT id, at_ns, actor, authentication, role, request, action, subject, subject_id,
             robot, before, after, reason FROM audit WHERE true",
    );
    if let Some(robot) = &filter.robot {
        query
            .push(" AND robot = ")
            .push_bind(robot.as_str().to_owned());
    }
    if let Some(actor) = &filter.actor {
        query.push(" AND actor = ").push_bind(actor.clone());
    }
    if let Some(action) = &filter.action {
        query
            .push(" AND substr(action, 1, length(")
            .push_bind(action.clone());
        query.push(")) = ").push_bind(action.clone());
    }
    if let Some(from_ns) = filter.from_ns {
        query.push(" AND at_ns >= ").push_bind(from_ns);
    }
    if let Some(to_ns) = filter.to_ns {
        query.push(" AND at_ns < ").push_bind(to_ns);
    }
    if let Some(before) = filter.before {
        query.push(" AND id < ").push_bind(before);
    }
    query
        .push(" ORDER BY id DESC LIMIT ")
        .push_bind(i64::from(filter.limit));
    let rows = query.build().fetch_all(pool).await;
    rows.map_err(StoreError::database("read the audit"))?
        .iter()
        .map(audit_row)
        .collect()
}

fn audit_row(row: &SqliteRow) -> Result<AuditRow, StoreError> {
    let table = "audit";
    let document = |index| -> Result<Option<serde_json::Value>, StoreError> {
        let text: Option<String> = column(row, table, index)?;
        text.map(|text| parsed(table, &text)).transpose()
    };
    Ok(AuditRow {
        id: column(row, table, 0)?,
        at_ns: column(row, table, 1)?,
        actor: column(row, table, 2)?,
        authentication: column(row, table, 3)?,
        role: column(row, table, 4)?,
        request: column(row, table, 5)?,
        action: column(row, table, 6)?,
        subject: column(row, table, 7)?,
        subject_id: column(row, table, 8)?,
        robot: column(row, table, 9)?,
        before: document(10)?,
        after: document(11)?,
        reason: column(row, table, 12)?,
    })
}

fn json<T: Serialize>(record: &T) -> Result<String, StoreError> {
    serde_json::to_string(record).map_err(|error| StoreError::Corrupt {
        table: "record",
        reason: error.to_string(),
    })
}

fn record<T: DeserializeOwned>(
    row: &SqliteRow,
    table: &'static str,
    index: usize,
) -> Result<T, StoreError> {
    let text: String = row
        .try_get(index)
        .map_err(StoreError::database("read a record of the life cycle"))?;
    parsed(table, &text)
}

fn number(row: &SqliteRow, index: usize) -> Result<u64, StoreError> {
    let number: i64 = column(row, "record", index)?;
    u64::try_from(number).map_err(|_| StoreError::Corrupt {
        table: "record",
        reason: format!("{number} is no number of a record"),
    })
}
