//! Queries of the life cycle's records.

use std::collections::BTreeMap;

use fleetcal_domain::approval::{
    Deployment, DeploymentState, OutboxEntry, Proposal, Revision, RobotLedger, Shadow,
};
use fleetcal_domain::limits;
use fleetcal_model::{AuditId, Generation, ProposalId, Version};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Envelope;
use fleetcal_store::{AuditFilter, AuditRow, DeploymentFreeze, ProposalFilter, StoreError};
use serde::de::DeserializeOwned;

use super::connection::Connection;
use super::query::query;
use super::row::{column, parsed, robot_id, wall_time, wall_time_or_null};
use super::value::Row;

/// Condition of deployments in progress.
pub(super) const LIVE: &str =
    "state IN ('queued', 'offered', 'applied', 'verifying', 'rolling_back')";

/// Returns the records of every robot that has any.
pub(super) async fn ledgers(
    connection: &mut dyn Connection,
) -> Result<Vec<RobotLedger>, StoreError> {
    let failed = || StoreError::database("read the robots' records");
    let mut found: BTreeMap<RobotId, RobotLedger> = BTreeMap::new();
    let rows = query("SELECT record FROM shadow")
        .fetch_all(&mut *connection)
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
    let rows =
        query("SELECT record FROM proposal WHERE state = 'proposed'").fetch_all(&mut *connection);
    for row in rows.await.map_err(failed())? {
        let open: Proposal = record(&row, "proposal", 0)?;
        of(&open.robot.clone(), &mut |ledger| {
            ledger.open = Some(open.clone());
        });
    }
    let live = query("SELECT record FROM deployment WHERE ").push(LIVE);
    let rows = live.fetch_all(&mut *connection).await;
    for row in rows.map_err(failed())? {
        let live: Deployment = record(&row, "deployment", 0)?;
        of(&live.robot.clone(), &mut |ledger| {
            ledger.live = Some(live.clone());
        });
    }
    for ledger in found.values_mut() {
        for id in ledger.named_revisions() {
            let row = query("SELECT record FROM revision WHERE id = $1").bind(id.0 as i64);
            let row = row.fetch_one(&mut *connection).await.map_err(failed())?;
            ledger.revisions.insert(id, record(&row, "revision", 0)?);
        }
    }
    Ok(found.into_values().collect())
}

/// Returns a signed document.
pub(super) async fn envelope(
    connection: &mut dyn Connection,
    robot: &RobotId,
    generation: Generation,
) -> Result<Option<Envelope>, StoreError> {
    let row = query("SELECT record FROM envelope WHERE robot = $1 AND generation = $2")
        .bind(robot.as_str())
        .bind(generation.0 as i64)
        .fetch_optional(&mut *connection)
        .await
        .map_err(StoreError::database("read a signed document"))?;
    row.map(|row| record(&row, "envelope", 0)).transpose()
}

/// Returns the outbox messages.
pub(super) async fn outbox(
    connection: &mut dyn Connection,
) -> Result<Vec<(RobotId, OutboxEntry)>, StoreError> {
    let rows = query("SELECT robot, kind, generation FROM outbox ORDER BY robot, kind")
        .fetch_all(&mut *connection)
        .await
        .map_err(StoreError::database("read the outbox"))?;
    rows.iter()
        .map(|row| {
            let kind: String = column(row, "outbox", 1)?;
            let generation = number(row, 2)?;
            let entry = if kind == "approved" {
                OutboxEntry::Approved(Generation(generation))
            } else {
                OutboxEntry::Confirmed(Generation(generation))
            };
            Ok((robot_id(row, "outbox", 0)?, entry))
        })
        .collect()
}

/// Returns proposals with their revisions, newest first.
pub(super) async fn proposals(
    connection: &mut dyn Connection,
    filter: &ProposalFilter,
) -> Result<Vec<(Proposal, Revision)>, StoreError> {
    let mut proposals = query(
        "SELECT p.record, r.record FROM proposal AS p JOIN revision AS r ON r.id = p.revision
         WHERE true",
    );
    if let Some(robot) = &filter.robot {
        proposals = proposals.push(" AND p.robot = ").push_bind(robot.as_str());
    }
    if let Some(state) = filter.state {
        proposals = proposals.push(" AND p.state = ").push_bind(state.as_str());
    }
    if let Some(before) = filter.before {
        proposals = proposals.push(" AND p.id < ").push_bind(before);
    }
    let rows = proposals
        .push(" ORDER BY p.id DESC LIMIT ")
        .push_bind(i64::from(filter.limit))
        .fetch_all(connection)
        .await;
    rows.map_err(StoreError::database("read the proposals"))?
        .iter()
        .map(pair)
        .collect()
}

/// Returns one proposal with its revision.
pub(super) async fn proposal(
    connection: &mut dyn Connection,
    id: ProposalId,
) -> Result<Option<(Proposal, Revision)>, StoreError> {
    let row = query(
        "SELECT p.record, r.record FROM proposal AS p JOIN revision AS r ON r.id = p.revision
         WHERE p.id = $1",
    )
    .bind(i64::try_from(id.0).unwrap_or(i64::MAX))
    .fetch_optional(&mut *connection)
    .await
    .map_err(StoreError::database("read a proposal"))?;
    row.as_ref().map(pair).transpose()
}

fn pair(row: &Row) -> Result<(Proposal, Revision), StoreError> {
    Ok((record(row, "proposal", 0)?, record(row, "revision", 1)?))
}

/// Returns a robot's deployments, newest first.
pub(super) async fn deployments(
    connection: &mut dyn Connection,
    robot: &RobotId,
    before: Option<i64>,
    limit: u32,
) -> Result<Vec<Deployment>, StoreError> {
    let rows = query(
        "SELECT record FROM deployment WHERE robot = $1 AND id < $2 ORDER BY id DESC LIMIT $3",
    )
    .bind(robot.as_str())
    .bind(before.unwrap_or(i64::MAX))
    .bind(i64::from(limit))
    .fetch_all(&mut *connection)
    .await
    .map_err(StoreError::database("read a robot's deployments"))?;
    rows.iter()
        .map(|row| record(row, "deployment", 0))
        .collect()
}

/// Returns the state of each approved proposal: that of its deployment, unless a later return has
/// undone it.
pub(super) async fn followed(
    connection: &mut dyn Connection,
    proposals: &[ProposalId],
) -> Result<BTreeMap<ProposalId, DeploymentState>, StoreError> {
    let deployments = "SELECT record FROM deployment WHERE proposal IN (NULL";
    let deployments = approved(connection, deployments, proposals, ")").await?;
    let returns = "SELECT record FROM deployment WHERE proposal IS NULL AND robot IN \
                   (SELECT robot FROM deployment WHERE proposal IN (NULL";
    let returns = approved(connection, returns, proposals, "))").await?;
    let followed = deployments.iter().filter_map(|one| {
        let proposal = one.proposal?;
        Some((proposal, one.state_after(&returns)))
    });
    Ok(followed.collect())
}

/// Returns the deployments that a statement finds for a list of proposals, newest first.
async fn approved(
    connection: &mut dyn Connection,
    before: &'static str,
    proposals: &[ProposalId],
    after: &'static str,
) -> Result<Vec<Deployment>, StoreError> {
    let mut found = query(before);
    for id in proposals {
        let id = i64::try_from(id.0).unwrap_or(i64::MAX);
        found = found.push(", ").push_bind(id);
    }
    let rows = found
        .push(after)
        .push(" ORDER BY id DESC LIMIT ")
        .push_bind(i64::from(limits::FOLLOWED_MAX))
        .fetch_all(connection)
        .await
        .map_err(StoreError::database("read what followed from proposals"))?;
    rows.iter()
        .map(|row| record(row, "deployment", 0))
        .collect()
}

/// Returns the deployment freeze.
pub(super) async fn deployment_freeze(
    connection: &mut dyn Connection,
) -> Result<DeploymentFreeze, StoreError> {
    let row = query("SELECT version, held, by, at_ns, reason FROM site")
        .fetch_one(connection)
        .await
        .map_err(StoreError::database("read the deployment freeze"))?;
    site_of(&row)
}

fn site_of(row: &Row) -> Result<DeploymentFreeze, StoreError> {
    Ok(DeploymentFreeze {
        version: number(row, 0).map(Version)?,
        frozen: column(row, "site", 1)?,
        by: column(row, "site", 2)?,
        at_ns: wall_time_or_null(row, "site", 3)?,
        reason: column(row, "site", 4)?,
    })
}

/// Reads rows of the audit for [`audit_row`].
const AUDIT: &str = "SELECT id, at_ns, actor, authentication, role, request, action, subject,
    subject_id, robot, before, after, reason, address, link FROM audit";

/// Returns the rows of the audit after a number, oldest first.
pub(super) async fn audit_rows_after(
    connection: &mut dyn Connection,
    after: AuditId,
    limit: u32,
) -> Result<Vec<AuditRow>, StoreError> {
    let audit = query(AUDIT).push(" WHERE id > $1 ORDER BY id LIMIT $2");
    let rows = audit.bind(after.0).bind(limit).fetch_all(connection).await;
    rows.map_err(StoreError::database("read the audit"))?
        .iter()
        .map(audit_row)
        .collect()
}

/// Returns the rows of the audit after a number that are notes about a robot, oldest first.
pub(super) async fn notes_after(
    connection: &mut dyn Connection,
    robot: &RobotId,
    after: AuditId,
    limit: u32,
) -> Result<Vec<AuditRow>, StoreError> {
    let notes = query(AUDIT)
        .push(" WHERE robot = $1 AND id > $2 AND subject = 'event' ORDER BY id LIMIT $3")
        .bind(robot.as_str())
        .bind(after.0)
        .bind(limit);
    let rows = notes.fetch_all(connection).await;
    rows.map_err(StoreError::database("read the notes"))?
        .iter()
        .map(audit_row)
        .collect()
}

/// Returns rows of the audit, newest first.
pub(super) async fn audit_rows(
    connection: &mut dyn Connection,
    filter: &AuditFilter,
) -> Result<Vec<AuditRow>, StoreError> {
    let mut audit = query(AUDIT).push(" WHERE true");
    if let Some(robot) = &filter.robot {
        audit = audit.push(" AND robot = ").push_bind(robot.as_str());
    }
    if let Some(actor) = &filter.actor {
        audit = audit.push(" AND actor = ").push_bind(actor);
    }
    if let Some(action) = &filter.action {
        audit = audit
            .push(" AND substr(action, 1, length(")
            .push_bind(action)
            .push(")) = ")
            .push_bind(action);
    }
    if let Some(from_ns) = filter.from_ns {
        audit = audit.push(" AND at_ns >= ").push_bind(from_ns.0);
    }
    if let Some(to_ns) = filter.to_ns {
        audit = audit.push(" AND at_ns < ").push_bind(to_ns.0);
    }
    if let Some(before) = filter.before {
        audit = audit.push(" AND id < ").push_bind(before);
    }
    let rows = audit
        .push(" ORDER BY id DESC LIMIT ")
        .push_bind(i64::from(filter.limit))
        .fetch_all(connection)
        .await;
    rows.map_err(StoreError::database("read the audit"))?
        .iter()
        .map(audit_row)
        .collect()
}

fn audit_row(row: &Row) -> Result<AuditRow, StoreError> {
    let table = "audit";
    let document = |index| -> Result<Option<serde_json::Value>, StoreError> {
        let text: Option<String> = column(row, table, index)?;
        text.map(|text| parsed(table, &text)).transpose()
    };
    Ok(AuditRow {
        id: column(row, table, 0).map(AuditId)?,
        at_ns: wall_time(row, table, 1)?,
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
        address: column(row, table, 13)?,
        link: column(row, table, 14)?,
    })
}

pub(super) fn record<T: DeserializeOwned>(
    row: &Row,
    table: &'static str,
    index: usize,
) -> Result<T, StoreError> {
    let text: String = column(row, table, index)?;
    parsed(table, &text)
}

pub(super) fn number(row: &Row, index: usize) -> Result<u64, StoreError> {
    let number: i64 = column(row, "record", index)?;
    u64::try_from(number).map_err(|_| StoreError::Corrupt {
        table: "record",
        reason: format!("{number} is no number of a record"),
    })
}
