//! The life cycle's records: each decision is read, taken and written in one transaction.

use fleetcal_domain::approval::{
    self, GenerationRef, NextIds, Outcome, Parcel, Policy, Proposal, Refused, RobotLedger, Standing,
};
use fleetcal_proto::RobotId;
use fleetcal_store::{AuditEntry, Decided, Decision, HoldWrite, SiteHold, StoreError};
use serde::Serialize;
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use sqlx::{QueryBuilder, Sqlite};

use super::audit;
use super::records::{LIVE, may_change, number, record, site_hold};
use super::row::column;

/// Takes a decision by these rules in the transaction that the connection is in.
///
/// # Errors
/// [`StoreError::Refused`] and [`StoreError::KeyReused`] before anything is written.
pub(super) async fn decide(
    connection: &mut SqliteConnection,
    decision: &Decision,
    policy: &Policy,
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
        policy,
        key: &decision.key,
        actor: &decision.actor,
        now_ns: decision.now_ns,
        held: match decision.command {
            approval::Command::Offer { .. } => site_hold(&mut *connection).await?.held,
            _ => false,
        },
        rear_axle_in_base_link: decision.rear_axle_in_base_link,
        present: decision.present,
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
            chosen_by: None,
        })
    };
    row.map(of).transpose()
}

/// Holds or releases the site-wide stop.
pub(super) async fn hold(
    connection: &mut SqliteConnection,
    write: &HoldWrite,
) -> Result<SiteHold, StoreError> {
    let before = site_hold(&mut *connection).await?;
    may_change(before.version, write.version, &write.reason)?;
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
        .map_err(StoreError::database("write the site-wide stop"))?;
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

fn json<T: Serialize>(record: &T) -> Result<String, StoreError> {
    serde_json::to_string(record).map_err(|error| StoreError::Corrupt {
        table: "record",
        reason: error.to_string(),
    })
}
