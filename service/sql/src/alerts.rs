//! Alerts and how they went.

use async_trait::async_trait;
use fleetcal_domain::alert::{Alert, AlertKind, Named, StoredAlert, Subject};
use fleetcal_model::{AlertId, Version};
use fleetcal_store::transaction::AlertRecords;
use fleetcal_store::{AlertFilter, AlertMoment, AlertSelection, StoreError};

use super::connection::Connection;
use super::query::{query, query_scalar};
use super::row::{column, corrupt, json, wall_time};
use super::transaction::SqlRecords;
use super::value::Row;

const TABLE: &str = "alert";

#[async_trait]
impl AlertRecords for SqlRecords<'_> {
    async fn active_alert(
        &mut self,
        subject: &Subject,
        kind: AlertKind,
    ) -> Result<Option<StoredAlert>, StoreError> {
        let row = query(
            "SELECT id, record, rank FROM alert WHERE robot = $1 AND kind = $2 AND state <> 'normal'",
        )
        .bind(subject.as_str())
        .bind(kind.as_str())
        .fetch_optional(&mut *self.connection)
        .await
        .map_err(StoreError::database("read an alert"))?;
        row.as_ref().map(alert_of).transpose()
    }

    async fn alert(&mut self, id: AlertId) -> Result<Option<StoredAlert>, StoreError> {
        let row = query("SELECT id, record, rank FROM alert WHERE id = $1")
            .bind(i64::try_from(id.0).unwrap_or(i64::MAX))
            .fetch_optional(&mut *self.connection)
            .await
            .map_err(StoreError::database("read an alert"))?;
        row.as_ref().map(alert_of).transpose()
    }

    async fn add_alert(&mut self, alert: &Alert) -> Result<AlertId, StoreError> {
        let id = query_scalar("INSERT INTO alert (record, rank) VALUES ($1, $2) RETURNING id")
            .bind(json(TABLE, alert)?)
            .bind(i64::from(alert.rank()))
            .fetch_one(&mut *self.connection)
            .await
            .map_err(StoreError::database("write an alert"))?;
        number(id).map(AlertId)
    }

    async fn save_alert(&mut self, alert: &Alert) -> Result<(), StoreError> {
        query("UPDATE alert SET record = $1, rank = $2 WHERE id = $3")
            .bind(json(TABLE, alert)?)
            .bind(i64::from(alert.rank()))
            .bind(alert.id.0 as i64)
            .execute(&mut *self.connection)
            .await
            .map_err(StoreError::database("write an alert"))?;
        Ok(())
    }

    async fn delete_alert(&mut self, id: AlertId) -> Result<(), StoreError> {
        query("DELETE FROM alert WHERE id = $1")
            .bind(id.0 as i64)
            .execute(&mut *self.connection)
            .await
            .map_err(StoreError::database("delete an alert"))?;
        Ok(())
    }

    async fn add_alert_moment(
        &mut self,
        id: AlertId,
        moment: &AlertMoment,
        kept: u32,
    ) -> Result<(), StoreError> {
        let failed = || StoreError::database("write how an alert went");
        query(
            "INSERT INTO alert_change (alert, at_ns, version, state, what, by, note)
             VALUES ($1, $2, $3, $4, $5, $6, $7)",
        )
        .bind(id.0 as i64)
        .bind(moment.at_ns.0)
        .bind(moment.version.0 as i64)
        .bind(moment.state.as_str())
        .bind(&moment.what)
        .bind(&moment.by)
        .bind(&moment.note)
        .execute(&mut *self.connection)
        .await
        .map_err(failed())?;
        query(
            "DELETE FROM alert_change WHERE alert = $1 AND id <= (SELECT id FROM alert_change
             WHERE alert = $1 ORDER BY id DESC LIMIT 1 OFFSET $2)",
        )
        .bind(id.0 as i64)
        .bind(i64::from(kept))
        .execute(&mut *self.connection)
        .await
        .map_err(failed())?;
        Ok(())
    }
}

/// Returns every alert of a known kind and condition that is not over.
pub(super) async fn active_alerts(
    connection: &mut dyn Connection,
) -> Result<Vec<Alert>, StoreError> {
    let rows = query("SELECT id, record, rank FROM alert WHERE state <> 'normal' ORDER BY id")
        .fetch_all(&mut *connection)
        .await
        .map_err(StoreError::database("read the alerts"))?;
    let stored = rows.iter().map(alert_of);
    let known = stored.filter_map(|one| one.map(StoredAlert::known).transpose());
    known.collect()
}

/// Returns alerts, the most urgent first.
pub(super) async fn alerts(
    connection: &mut dyn Connection,
    filter: &AlertFilter,
) -> Result<Vec<StoredAlert>, StoreError> {
    let robots = connection.dialect().robots_of_alert();
    let mut alerts = query("SELECT id, record, rank FROM alert WHERE true");
    if let Some(robot) = &filter.robot {
        // An alert about several names them.
        alerts = alerts
            .push(" AND (robot = ")
            .push_bind(robot.as_str())
            .push(" OR EXISTS (SELECT 1 FROM ")
            .push(robots)
            .push(" WHERE value = ")
            .push_bind(robot.as_str())
            .push("))");
    }
    alerts = match filter.selection {
        Some(AlertSelection::Active) => alerts.push(" AND state <> 'normal'"),
        Some(AlertSelection::In(state)) => alerts.push(" AND state = ").push_bind(state.as_str()),
        None => alerts,
    };
    if let Some((rank, id)) = filter.after {
        alerts = alerts
            .push(" AND (rank > ")
            .push_bind(i64::from(rank))
            .push(" OR (rank = ")
            .push_bind(i64::from(rank))
            .push(" AND id < ")
            .push_bind(id)
            .push("))");
    }
    let rows = alerts
        .push(" ORDER BY rank, id DESC LIMIT ")
        .push_bind(i64::from(filter.limit))
        .fetch_all(connection)
        .await;
    rows.map_err(StoreError::database("read the alerts"))?
        .iter()
        .map(alert_of)
        .collect()
}

/// Returns one alert with its changes.
pub(super) async fn alert(
    connection: &mut dyn Connection,
    id: AlertId,
) -> Result<Option<(StoredAlert, Vec<AlertMoment>)>, StoreError> {
    let id = i64::try_from(id.0).unwrap_or(i64::MAX);
    let row = query("SELECT id, record, rank FROM alert WHERE id = $1")
        .bind(id)
        .fetch_optional(&mut *connection)
        .await
        .map_err(StoreError::database("read an alert"))?;
    let Some(row) = row else { return Ok(None) };
    let changes = query(
        "SELECT at_ns, version, state, what, by, note FROM alert_change WHERE alert = $1
         ORDER BY id",
    )
    .bind(id)
    .fetch_all(&mut *connection)
    .await
    .map_err(StoreError::database("read how an alert went"))?;
    let changes: Result<_, _> = changes.iter().map(moment_of).collect();
    Ok(Some((alert_of(&row)?, changes?)))
}

fn alert_of(row: &Row) -> Result<StoredAlert, StoreError> {
    let id = number(column(row, TABLE, 0)?).map(AlertId)?;
    let record: String = column(row, TABLE, 1)?;
    let rank: i64 = column(row, TABLE, 2)?;
    let rank = u32::try_from(rank).map_err(corrupt(TABLE))?;
    StoredAlert::parse(id, rank, &record).map_err(corrupt(TABLE))
}

fn moment_of(row: &Row) -> Result<AlertMoment, StoreError> {
    const TABLE: &str = "alert_change";
    let state: String = column(row, TABLE, 2)?;
    Ok(AlertMoment {
        at_ns: wall_time(row, TABLE, 0)?,
        version: number(column(row, TABLE, 1)?).map(Version)?,
        state: Named::condition(&state),
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
