//! Webhooks, and the outbox of what is told to them.

use async_trait::async_trait;
use fleetcal_domain::limits;
use fleetcal_domain::webhook::{Delivery, DeliveryState, Secret, Webhook, WebhookEvent};
use fleetcal_model::{DeliveryId, WallTime, WebhookId};
use fleetcal_store::transaction::WebhookRecords;
use fleetcal_store::{DueDelivery, StoreError};

use super::connection::Connection;
use super::query::{query, query_scalar};
use super::row::{column, json, parsed, wall_time, wall_time_or_null};
use super::transaction::SqlRecords;
use super::value::Row;

const TABLE: &str = "webhook_delivery";
/// Columns that [`delivery_of`] reads.
macro_rules! delivery_columns {
    () => {
        "d.id, d.webhook, d.message, d.event, d.body, d.created_ns, d.state, d.due_ns, \
         d.attempts_made, d.attempts, d.finished_ns"
    };
}

#[async_trait]
impl WebhookRecords for SqlRecords<'_> {
    async fn webhooks(&mut self) -> Result<Vec<(Webhook, Secret)>, StoreError> {
        let rows = query("SELECT id, record, secret FROM webhook ORDER BY id")
            .fetch_all(&mut *self.connection)
            .await
            .map_err(StoreError::database("read the webhooks"))?;
        let one = |row: &Row| {
            let secret = Secret::from_bytes(column(row, "webhook", 2)?);
            Ok((webhook_of(row)?, secret))
        };
        rows.iter().map(one).collect()
    }

    async fn add_webhook(
        &mut self,
        webhook: &Webhook,
        secret: &Secret,
    ) -> Result<WebhookId, StoreError> {
        let id = query_scalar("INSERT INTO webhook (record, secret) VALUES ($1, $2) RETURNING id")
            .bind(json("webhook", webhook)?)
            .bind(secret.as_bytes())
            .fetch_one(&mut *self.connection)
            .await
            .map_err(StoreError::database("write a webhook"))?;
        number(id).map(WebhookId)
    }

    async fn delete_webhook(&mut self, id: WebhookId) -> Result<(), StoreError> {
        query("DELETE FROM webhook WHERE id = $1")
            .bind(id.0 as i64)
            .execute(&mut *self.connection)
            .await
            .map_err(StoreError::database("delete a webhook"))?;
        Ok(())
    }

    async fn delivery(&mut self, id: DeliveryId) -> Result<Option<Delivery>, StoreError> {
        let sql = concat!(
            "SELECT ",
            delivery_columns!(),
            " FROM webhook_delivery AS d WHERE d.id = $1"
        );
        let row = query(sql)
            .bind(id.0 as i64)
            .fetch_optional(&mut *self.connection)
            .await
            .map_err(StoreError::database("read a delivery"))?;
        row.as_ref().map(delivery_of).transpose()
    }

    async fn add_delivery(&mut self, delivery: &Delivery) -> Result<(), StoreError> {
        query(
            "INSERT INTO webhook_delivery (webhook, message, event, body, created_ns, state,
                 due_ns, attempts_made, attempts, finished_ns)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10)",
        )
        .bind(delivery.webhook.0 as i64)
        .bind(&delivery.message)
        .bind(delivery.event.as_str())
        .bind(&delivery.body)
        .bind(delivery.created_ns.0)
        .bind(delivery.state.as_str())
        .bind(delivery.due_ns.0)
        .bind(i64::from(delivery.attempts_made))
        .bind(json(TABLE, &delivery.attempts)?)
        .bind(delivery.finished_ns.map(|at| at.0))
        .execute(&mut *self.connection)
        .await
        .map_err(StoreError::database("write what is told"))?;
        Ok(())
    }

    async fn save_delivery(&mut self, delivery: &Delivery) -> Result<(), StoreError> {
        query(
            "UPDATE webhook_delivery SET state = $2, due_ns = $3, attempts_made = $4,
                 attempts = $5, finished_ns = $6 WHERE id = $1",
        )
        .bind(delivery.id.0 as i64)
        .bind(delivery.state.as_str())
        .bind(delivery.due_ns.0)
        .bind(i64::from(delivery.attempts_made))
        .bind(json(TABLE, &delivery.attempts)?)
        .bind(delivery.finished_ns.map(|at| at.0))
        .execute(&mut *self.connection)
        .await
        .map_err(StoreError::database("write an attempt"))?;
        Ok(())
    }

    async fn give_up_deliveries(
        &mut self,
        webhook: WebhookId,
        kept: u32,
        now: WallTime,
    ) -> Result<u64, StoreError> {
        let done = query(
            "UPDATE webhook_delivery SET state = 'given_up', finished_ns = $3
             WHERE webhook = $1 AND state = 'waiting' AND id <= (SELECT id FROM webhook_delivery
                 WHERE webhook = $1 AND state = 'waiting' ORDER BY id DESC LIMIT 1 OFFSET $2)",
        )
        .bind(webhook.0 as i64)
        .bind(i64::from(kept))
        .bind(now.0)
        .execute(&mut *self.connection)
        .await
        .map_err(StoreError::database("give up what is told"))?;
        Ok(done)
    }

    async fn forget_deliveries(&mut self, webhook: WebhookId, kept: u32) -> Result<(), StoreError> {
        query(
            "DELETE FROM webhook_delivery WHERE webhook = $1 AND state <> 'waiting' AND id <= (
                 SELECT id FROM webhook_delivery WHERE webhook = $1 AND state <> 'waiting'
                 ORDER BY id DESC LIMIT 1 OFFSET $2)",
        )
        .bind(webhook.0 as i64)
        .bind(i64::from(kept))
        .execute(&mut *self.connection)
        .await
        .map_err(StoreError::database("forget what was told"))?;
        Ok(())
    }
}

/// Returns every webhook, oldest first.
pub(super) async fn webhooks(connection: &mut dyn Connection) -> Result<Vec<Webhook>, StoreError> {
    let rows = query("SELECT id, record FROM webhook ORDER BY id")
        .fetch_all(&mut *connection)
        .await
        .map_err(StoreError::database("read the webhooks"))?;
    rows.iter().map(webhook_of).collect()
}

/// Returns a webhook's deliveries, newest first.
pub(super) async fn deliveries(
    connection: &mut dyn Connection,
    webhook: WebhookId,
    before: Option<i64>,
    limit: u32,
) -> Result<Vec<Delivery>, StoreError> {
    let sql = concat!(
        "SELECT ",
        delivery_columns!(),
        " FROM webhook_delivery AS d WHERE d.webhook = $1 AND d.id < $2
         ORDER BY d.id DESC LIMIT $3"
    );
    let rows = query(sql)
        .bind(i64::try_from(webhook.0).unwrap_or(i64::MAX))
        .bind(before.unwrap_or(i64::MAX))
        .bind(i64::from(limit))
        .fetch_all(&mut *connection)
        .await
        .map_err(StoreError::database("read a webhook's deliveries"))?;
    rows.iter().map(delivery_of).collect()
}

/// Returns the oldest due delivery of each webhook.
pub(super) async fn due(
    connection: &mut dyn Connection,
    now: WallTime,
) -> Result<Vec<DueDelivery>, StoreError> {
    let sql = concat!(
        "SELECT ",
        delivery_columns!(),
        ", w.id, w.record, w.secret
         FROM webhook_delivery AS d JOIN webhook AS w ON w.id = d.webhook
         WHERE d.id IN (SELECT min(id) FROM webhook_delivery
             WHERE state = 'waiting' AND (due_ns <= $1 OR due_ns > $2) GROUP BY webhook)
         ORDER BY d.id"
    );
    let rows = query(sql)
        .bind(now.0)
        .bind(now.plus(limits::WEBHOOK_BACKOFF_MAX).0)
        .fetch_all(&mut *connection)
        .await
        .map_err(StoreError::database("read what is to be told"))?;
    let due = |row: &Row| {
        let record: String = column(row, "webhook", 12)?;
        let webhook: Webhook = parsed("webhook", &record)?;
        Ok(DueDelivery {
            delivery: delivery_of(row)?,
            url: webhook.url,
            secret: Secret::from_bytes(column(row, "webhook", 13)?),
        })
    };
    rows.iter().map(due).collect()
}

/// Returns the number of waiting deliveries.
pub(super) async fn waiting(connection: &mut dyn Connection) -> Result<u64, StoreError> {
    let count = query_scalar("SELECT count(*) FROM webhook_delivery WHERE state = 'waiting'")
        .fetch_one(&mut *connection)
        .await
        .map_err(StoreError::database("count what is to be told"))?;
    number(count)
}

fn webhook_of(row: &Row) -> Result<Webhook, StoreError> {
    let record: String = column(row, "webhook", 1)?;
    let webhook: Webhook = parsed("webhook", &record)?;
    Ok(Webhook {
        id: number(column(row, "webhook", 0)?).map(WebhookId)?,
        ..webhook
    })
}

fn delivery_of(row: &Row) -> Result<Delivery, StoreError> {
    let unknown = |what: &str, name: &str| StoreError::Corrupt {
        table: TABLE,
        reason: format!("{what} {name:?} is unknown"),
    };
    let event: String = column(row, TABLE, 3)?;
    let state: String = column(row, TABLE, 6)?;
    let attempts_made: i64 = column(row, TABLE, 8)?;
    let attempts: String = column(row, TABLE, 9)?;
    Ok(Delivery {
        id: number(column(row, TABLE, 0)?).map(DeliveryId)?,
        webhook: number(column(row, TABLE, 1)?).map(WebhookId)?,
        message: column(row, TABLE, 2)?,
        event: WebhookEvent::parse(&event).ok_or_else(|| unknown("event", &event))?,
        body: column(row, TABLE, 4)?,
        created_ns: wall_time(row, TABLE, 5)?,
        state: DeliveryState::parse(&state).ok_or_else(|| unknown("state", &state))?,
        due_ns: wall_time(row, TABLE, 7)?,
        attempts_made: u32::try_from(attempts_made).unwrap_or(u32::MAX),
        attempts: parsed(TABLE, &attempts)?,
        finished_ns: wall_time_or_null(row, TABLE, 10)?,
    })
}

fn number(number: i64) -> Result<u64, StoreError> {
    u64::try_from(number).map_err(|_| StoreError::Corrupt {
        table: TABLE,
        reason: format!("{number} is no number of a record"),
    })
}
