//! Alerts: each change is read, made and written in one transaction, with what is told of it.

use fleetcal_domain::alert::{
    self, Acknowledgement, Alert, AlertKind, AlertPolicy, AlertRefused, ConditionName, Notice,
    Sighting, Step, Subject,
};
use fleetcal_domain::limits;
use fleetcal_domain::webhook::Message;
use fleetcal_store::{
    AcknowledgeWrite, AlertChange, AlertFilter, AlertMoment, AlertSelection, AlertWrite,
    AuditEntry, StoreError,
};
use sqlx::sqlite::{SqliteConnection, SqlitePool, SqliteRow};
use sqlx::{QueryBuilder, Sqlite};

use super::row::{column, parsed};
use super::{audit, webhooks};

const TABLE: &str = "alert";

/// Changes alerts in the transaction that the connection is in.
///
/// # Errors
/// [`StoreError::Alert`] before anything is written.
pub(super) async fn write(
    connection: &mut SqliteConnection,
    write: &AlertWrite,
) -> Result<Vec<AlertChange>, StoreError> {
    match write {
        AlertWrite::Observe {
            sightings,
            policy,
            now_ns,
        } => {
            let mut changes = Vec::new();
            for (robot, sighting) in sightings {
                let change = observe(connection, robot, sighting, policy, *now_ns).await?;
                changes.extend(change);
            }
            Ok(changes)
        }
        AlertWrite::Acknowledge(write) => {
            let alert = acknowledge(connection, write).await?;
            Ok(vec![AlertChange::Kept(Box::new(alert))])
        }
    }
}

async fn observe(
    connection: &mut SqliteConnection,
    robot: &Subject,
    sighting: &Sighting,
    policy: &AlertPolicy,
    now_ns: i64,
) -> Result<Option<AlertChange>, StoreError> {
    let before = active(connection, robot, sighting.kind).await?;
    let periods = policy.periods(sighting.kind);
    match alert::step(before.as_ref(), robot, sighting, now_ns, periods) {
        Step::Same => Ok(None),
        Step::Dropped => {
            let Some(before) = before else {
                return Ok(None);
            };
            sqlx::query("DELETE FROM alert WHERE id = ?1")
                .bind(before.id as i64)
                .execute(connection)
                .await
                .map_err(StoreError::database("delete an alert"))?;
            Ok(Some(AlertChange::Dropped(Box::new(before))))
        }
        Step::Retold(alert) => {
            retell(connection, &alert).await?;
            Ok(Some(AlertChange::Kept(alert)))
        }
        Step::Changed(mut alert, notice) => {
            save(connection, &mut alert, None, now_ns).await?;
            if let Some(notice) = notice {
                tell(connection, &alert, notice, now_ns).await?;
            }
            Ok(Some(AlertChange::Kept(alert)))
        }
    }
}

async fn tell(
    connection: &mut SqliteConnection,
    alert: &Alert,
    notice: Notice,
    now_ns: i64,
) -> Result<(), StoreError> {
    let message = Message::of_alert(alert, notice, now_ns);
    let message = message.map_err(|error| unwritable(&error))?;
    webhooks::enqueue(connection, &message, now_ns).await
}

async fn acknowledge(
    connection: &mut SqliteConnection,
    write: &AcknowledgeWrite,
) -> Result<Alert, StoreError> {
    let row = sqlx::query("SELECT id, record FROM alert WHERE id = ?1")
        .bind(i64::try_from(write.id).unwrap_or(i64::MAX))
        .fetch_optional(&mut *connection)
        .await
        .map_err(StoreError::database("read an alert"))?;
    let row = row.ok_or(AlertRefused::Unknown(write.id))?;
    let before = alert_of(&row)?;
    let acknowledgement = Acknowledgement {
        by: write.actor.name.clone(),
        at_ns: write.now_ns,
        note: write.note.clone(),
    };
    let mut after = before.acknowledge(write.version, acknowledgement.clone())?;
    save(connection, &mut after, Some(&acknowledgement), write.now_ns).await?;
    let entry = AuditEntry {
        at_ns: write.now_ns,
        actor: write.actor.clone(),
        action: "alert.acknowledge",
        subject: "alert",
        subject_id: write.id.to_string(),
        robot: after.robot.robot().cloned(),
        before: serde_json::to_value(&before).ok(),
        after: serde_json::to_value(&after).ok(),
        reason: write.note.clone(),
    };
    audit::append(connection, &entry).await?;
    Ok(after)
}

/// Writes what an alert says now, which is no change of it.
async fn retell(connection: &mut SqliteConnection, alert: &Alert) -> Result<(), StoreError> {
    let record = serde_json::to_string(alert).map_err(|error| unwritable(&error))?;
    sqlx::query("UPDATE alert SET record = ?1 WHERE id = ?2")
        .bind(record)
        .bind(alert.id as i64)
        .execute(connection)
        .await
        .map_err(StoreError::database("write an alert"))?;
    Ok(())
}

/// Writes an alert and its change; a new one gets its number.
async fn save(
    connection: &mut SqliteConnection,
    alert: &mut Alert,
    acknowledged: Option<&Acknowledgement>,
    now_ns: i64,
) -> Result<(), StoreError> {
    let failed = || StoreError::database("write an alert");
    let record = serde_json::to_string(alert).map_err(|error| unwritable(&error))?;
    let is_new = alert.id == 0;
    let id: i64 = sqlx::query_scalar(if is_new {
        "INSERT INTO alert (record, rank) VALUES (?1, ?2) RETURNING id"
    } else {
        "UPDATE alert SET record = ?1, rank = ?2 WHERE id = ?3 RETURNING id"
    })
    .bind(record)
    .bind(i64::from(alert.rank()))
    .bind((!is_new).then_some(alert.id as i64))
    .fetch_one(&mut *connection)
    .await
    .map_err(failed())?;
    alert.id = u64::try_from(id).unwrap_or(0);
    sqlx::query(
        "INSERT INTO alert_change (alert, at_ns, version, state, what, by, note)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
    )
    .bind(id)
    .bind(now_ns)
    .bind(alert.version as i64)
    .bind(alert.condition.name().as_str())
    .bind(&alert.what)
    .bind(acknowledged.map(|one| &one.by))
    .bind(acknowledged.and_then(|one| one.note.as_ref()))
    .execute(&mut *connection)
    .await
    .map_err(failed())?;
    sqlx::query(
        "DELETE FROM alert_change WHERE alert = ?1 AND id <= (SELECT id FROM alert_change
         WHERE alert = ?1 ORDER BY id DESC LIMIT 1 OFFSET ?2)",
    )
    .bind(id)
    .bind(i64::from(limits::ALERT_CHANGES_MAX))
    .execute(connection)
    .await
    .map_err(failed())?;
    Ok(())
}

async fn active(
    connection: &mut SqliteConnection,
    robot: &Subject,
    kind: AlertKind,
) -> Result<Option<Alert>, StoreError> {
    let row = sqlx::query(
        "SELECT id, record FROM alert WHERE robot = ?1 AND kind = ?2 AND state <> 'normal'",
    )
    .bind(robot.as_str())
    .bind(kind.as_str())
    .fetch_optional(connection)
    .await
    .map_err(StoreError::database("read an alert"))?;
    row.as_ref().map(alert_of).transpose()
}

/// Every alert that is not over.
pub(super) async fn active_alerts(pool: &SqlitePool) -> Result<Vec<Alert>, StoreError> {
    let rows = sqlx::query("SELECT id, record FROM alert WHERE state <> 'normal' ORDER BY id")
        .fetch_all(pool)
        .await
        .map_err(StoreError::database("read the alerts"))?;
    rows.iter().map(alert_of).collect()
}

/// Alerts, the most urgent first.
pub(super) async fn alerts(
    pool: &SqlitePool,
    filter: &AlertFilter,
) -> Result<Vec<Alert>, StoreError> {
    let mut query = QueryBuilder::<Sqlite>::new("SELECT id, record FROM alert WHERE true");
    if let Some(robot) = &filter.robot {
        let robot = robot.as_str().to_owned();
        query.push(" AND (robot = ").push_bind(robot.clone());
        // An alert about several names them.
        query
            .push(" OR EXISTS (SELECT 1 FROM json_each(record, '$.robots') WHERE value = ")
            .push_bind(robot)
            .push("))");
    }
    match filter.selection {
        Some(AlertSelection::Active) => {
            query.push(" AND state <> 'normal'");
        }
        Some(AlertSelection::In(state)) => {
            query.push(" AND state = ").push_bind(state.as_str());
        }
        None => {}
    }
    if let Some((rank, id)) = filter.after {
        query.push(" AND (rank > ").push_bind(i64::from(rank));
        query.push(" OR (rank = ").push_bind(i64::from(rank));
        query.push(" AND id < ").push_bind(id).push("))");
    }
    query
        .push(" ORDER BY rank, id DESC LIMIT ")
        .push_bind(i64::from(filter.limit));
    let rows = query.build().fetch_all(pool).await;
    rows.map_err(StoreError::database("read the alerts"))?
        .iter()
        .map(alert_of)
        .collect()
}

/// One alert with how it went.
pub(super) async fn alert(
    pool: &SqlitePool,
    id: u64,
) -> Result<Option<(Alert, Vec<AlertMoment>)>, StoreError> {
    let id = i64::try_from(id).unwrap_or(i64::MAX);
    let row = sqlx::query("SELECT id, record FROM alert WHERE id = ?1")
        .bind(id)
        .fetch_optional(pool)
        .await
        .map_err(StoreError::database("read an alert"))?;
    let Some(row) = row else { return Ok(None) };
    let changes = sqlx::query(
        "SELECT at_ns, version, state, what, by, note FROM alert_change WHERE alert = ?1
         ORDER BY id",
    )
    .bind(id)
    .fetch_all(pool)
    .await
    .map_err(StoreError::database("read how an alert went"))?;
    let changes: Result<_, _> = changes.iter().map(moment_of).collect();
    Ok(Some((alert_of(&row)?, changes?)))
}

fn alert_of(row: &SqliteRow) -> Result<Alert, StoreError> {
    let id: i64 = column(row, TABLE, 0)?;
    let record: String = column(row, TABLE, 1)?;
    let alert: Alert = parsed(TABLE, &record)?;
    Ok(Alert {
        id: number(id)?,
        ..alert
    })
}

fn moment_of(row: &SqliteRow) -> Result<AlertMoment, StoreError> {
    const TABLE: &str = "alert_change";
    let state: String = column(row, TABLE, 2)?;
    Ok(AlertMoment {
        at_ns: column(row, TABLE, 0)?,
        version: number(column(row, TABLE, 1)?)?,
        state: ConditionName::parse(&state).ok_or_else(|| StoreError::Corrupt {
            table: TABLE,
            reason: format!("state {state:?} is unknown"),
        })?,
        what: column(row, TABLE, 3)?,
        by: column(row, TABLE, 4)?,
        note: column(row, TABLE, 5)?,
    })
}

fn number(number: i64) -> Result<u64, StoreError> {
    u64::try_from(number).map_err(|_| StoreError::Corrupt {
        table: TABLE,
        reason: format!("{number} is no number of a record"),
    })
}

fn unwritable(error: &serde_json::Error) -> StoreError {
    StoreError::Corrupt {
        table: TABLE,
        reason: error.to_string(),
    }
}
