//! Webhooks, and the outbox of what is told to them.

use fleetcal_domain::approval::{Outcome, Policy, automatic};
use fleetcal_domain::limits;
use fleetcal_domain::webhook::{
    Delivery, DeliveryState, Message, Secret, Webhook, WebhookEvent, WebhookRefused,
};
use fleetcal_store::{
    AttemptWrite, AuditEntry, CreateWrite, DeleteWrite, DueDelivery, StoreError, WebhookWrite,
    WebhookWritten,
};
use sqlx::sqlite::{SqliteConnection, SqlitePool, SqliteRow};

use super::audit;
use super::row::{column, parsed};

const TABLE: &str = "webhook_delivery";
/// The columns of [`delivery_of`].
macro_rules! delivery_columns {
    () => {
        "d.id, d.webhook, d.message, d.event, d.body, d.created_ns, d.state, d.due_ns, \
         d.attempts_made, d.attempts, d.finished_ns"
    };
}

/// Puts a message into the outbox of every webhook that is told of its event; the caller's
/// transaction is the one of the change that it tells.
pub(super) async fn enqueue(
    connection: &mut SqliteConnection,
    message: &Message,
    now_ns: i64,
) -> Result<(), StoreError> {
    let failed = || StoreError::database("write what is told");
    let rows = sqlx::query("SELECT id, record, secret FROM webhook ORDER BY id")
        .fetch_all(&mut *connection)
        .await
        .map_err(failed())?;
    for row in &rows {
        let webhook = webhook_of(row)?;
        if !webhook.events.contains(&message.event) {
            continue;
        }
        let secret = Secret::from_bytes(column(row, "webhook", 2)?);
        sqlx::query(
            "INSERT INTO webhook_delivery (webhook, message, event, body, created_ns, state,
                 due_ns, attempts_made, attempts)
             VALUES (?1, ?2, ?3, ?4, ?5, 'waiting', ?5, 0, '[]')",
        )
        .bind(webhook.id as i64)
        .bind(secret.message_id(&message.subject))
        .bind(message.event.as_str())
        .bind(&message.body)
        .bind(now_ns)
        .execute(&mut *connection)
        .await
        .map_err(failed())?;
        keep_within_limits(connection, webhook.id as i64, now_ns).await?;
    }
    Ok(())
}

/// Gives up the oldest of too many that wait, and forgets the oldest of too many that are done.
async fn keep_within_limits(
    connection: &mut SqliteConnection,
    webhook: i64,
    now_ns: i64,
) -> Result<(), StoreError> {
    let failed = || StoreError::database("shed what is told");
    let shed = sqlx::query(
        "UPDATE webhook_delivery SET state = 'given_up', finished_ns = ?3
         WHERE webhook = ?1 AND state = 'waiting' AND id <= (SELECT id FROM webhook_delivery
             WHERE webhook = ?1 AND state = 'waiting' ORDER BY id DESC LIMIT 1 OFFSET ?2)",
    )
    .bind(webhook)
    .bind(i64::from(limits::WEBHOOK_WAITING_MAX))
    .bind(now_ns)
    .execute(&mut *connection)
    .await
    .map_err(failed())?;
    if shed.rows_affected() > 0 {
        let shed = shed.rows_affected();
        tracing::error!(webhook, shed, "too many messages wait, the oldest are lost");
    }
    sqlx::query(
        "DELETE FROM webhook_delivery WHERE webhook = ?1 AND state <> 'waiting' AND id <= (
             SELECT id FROM webhook_delivery WHERE webhook = ?1 AND state <> 'waiting'
             ORDER BY id DESC LIMIT 1 OFFSET ?2)",
    )
    .bind(webhook)
    .bind(i64::from(limits::WEBHOOK_LOG_MAX))
    .execute(connection)
    .await
    .map_err(failed())?;
    Ok(())
}

/// Puts what a decision leaves waiting for people into the outbox, in its own transaction.
pub(super) async fn enqueue_proposals(
    connection: &mut SqliteConnection,
    outcome: &Outcome,
    policy: &Policy,
    now_ns: i64,
) -> Result<(), StoreError> {
    // What the service approves by itself waits for nobody.
    if automatic(&outcome.ledger, policy).is_some() {
        return Ok(());
    }
    for transition in &outcome.transitions {
        let message = Message::of_transition(transition, outcome, now_ns);
        let message = message.map_err(|error| StoreError::Corrupt {
            table: TABLE,
            reason: error.to_string(),
        })?;
        if let Some(message) = message {
            enqueue(connection, &message, now_ns).await?;
        }
    }
    Ok(())
}

/// Changes a webhook or a delivery in the transaction that the connection is in.
///
/// # Errors
/// [`StoreError::Webhook`] before anything is written.
pub(super) async fn write(
    connection: &mut SqliteConnection,
    write: &WebhookWrite,
) -> Result<WebhookWritten, StoreError> {
    match write {
        WebhookWrite::Create(write) => create(connection, write).await,
        WebhookWrite::Delete(write) => delete(connection, write).await,
        WebhookWrite::Attempted(write) => attempted(connection, write).await,
    }
}

async fn create(
    connection: &mut SqliteConnection,
    write: &CreateWrite,
) -> Result<WebhookWritten, StoreError> {
    let failed = || StoreError::database("write a webhook");
    let present = all(connection).await?;
    if let Some(same) = present.iter().find(|one| one.url == write.url) {
        return Err(StoreError::Webhook(WebhookRefused::UrlTaken(same.id)));
    }
    if present.len() >= limits::WEBHOOKS_MAX {
        return Err(StoreError::Webhook(WebhookRefused::TooMany));
    }
    let mut webhook = Webhook {
        id: 0,
        url: write.url.clone(),
        events: write.events.clone(),
        created_by: write.actor.name.clone(),
        created_ns: write.now_ns,
    };
    let record = serde_json::to_string(&webhook).map_err(|error| StoreError::Corrupt {
        table: "webhook",
        reason: error.to_string(),
    })?;
    let id: i64 =
        sqlx::query_scalar("INSERT INTO webhook (record, secret) VALUES (?1, ?2) RETURNING id")
            .bind(record)
            .bind(write.secret.as_bytes())
            .fetch_one(&mut *connection)
            .await
            .map_err(failed())?;
    webhook.id = number(id)?;
    let entry = AuditEntry {
        at_ns: write.now_ns,
        actor: write.actor.clone(),
        action: "webhook.create",
        subject: "webhook",
        subject_id: id.to_string(),
        robot: None,
        before: None,
        after: Some(webhook.audited()),
        reason: None,
    };
    audit::append(connection, &entry).await?;
    Ok(WebhookWritten::Webhook(Box::new(webhook)))
}

async fn delete(
    connection: &mut SqliteConnection,
    write: &DeleteWrite,
) -> Result<WebhookWritten, StoreError> {
    let present = all(connection).await?;
    let webhook = present.into_iter().find(|one| one.id == write.id);
    let webhook = webhook.ok_or(WebhookRefused::Unknown(write.id))?;
    sqlx::query("DELETE FROM webhook WHERE id = ?1")
        .bind(webhook.id as i64)
        .execute(&mut *connection)
        .await
        .map_err(StoreError::database("delete a webhook"))?;
    let entry = AuditEntry {
        at_ns: write.now_ns,
        actor: write.actor.clone(),
        action: "webhook.delete",
        subject: "webhook",
        subject_id: write.id.to_string(),
        robot: None,
        before: Some(webhook.audited()),
        after: None,
        reason: None,
    };
    audit::append(connection, &entry).await?;
    Ok(WebhookWritten::Webhook(Box::new(webhook)))
}

async fn attempted(
    connection: &mut SqliteConnection,
    write: &AttemptWrite,
) -> Result<WebhookWritten, StoreError> {
    let failed = || StoreError::database("write an attempt");
    let sql = concat!(
        "SELECT ",
        delivery_columns!(),
        " FROM webhook_delivery AS d WHERE d.id = ?1"
    );
    let row = sqlx::query(sql)
        .bind(write.delivery as i64)
        .fetch_optional(&mut *connection)
        .await
        .map_err(failed())?;
    let Some(row) = row else {
        return Ok(WebhookWritten::Delivery(None));
    };
    let before = delivery_of(&row)?;
    let mut after = before.after(write.attempt.clone(), write.now_ns, write.jitter);
    if before.state != DeliveryState::Waiting && after.state != DeliveryState::Delivered {
        // It was given up meanwhile, which stays so.
        after.state = before.state;
        after.finished_ns = before.finished_ns;
    }
    let attempts = serde_json::to_string(&after.attempts).map_err(|error| StoreError::Corrupt {
        table: TABLE,
        reason: error.to_string(),
    })?;
    sqlx::query(
        "UPDATE webhook_delivery SET state = ?2, due_ns = ?3, attempts_made = ?4, attempts = ?5,
             finished_ns = ?6 WHERE id = ?1",
    )
    .bind(after.id as i64)
    .bind(after.state.as_str())
    .bind(after.due_ns)
    .bind(i64::from(after.attempts_made))
    .bind(attempts)
    .bind(after.finished_ns)
    .execute(&mut *connection)
    .await
    .map_err(failed())?;
    keep_within_limits(connection, after.webhook as i64, write.now_ns).await?;
    Ok(WebhookWritten::Delivery(Some(Box::new(after))))
}

async fn all(connection: &mut SqliteConnection) -> Result<Vec<Webhook>, StoreError> {
    let rows = sqlx::query("SELECT id, record FROM webhook ORDER BY id")
        .fetch_all(connection)
        .await
        .map_err(StoreError::database("read the webhooks"))?;
    rows.iter().map(webhook_of).collect()
}

/// Every webhook, oldest first.
pub(super) async fn webhooks(pool: &SqlitePool) -> Result<Vec<Webhook>, StoreError> {
    let rows = sqlx::query("SELECT id, record FROM webhook ORDER BY id")
        .fetch_all(pool)
        .await
        .map_err(StoreError::database("read the webhooks"))?;
    rows.iter().map(webhook_of).collect()
}

/// A webhook's deliveries, newest first.
pub(super) async fn deliveries(
    pool: &SqlitePool,
    webhook: u64,
    before: Option<i64>,
    limit: u32,
) -> Result<Vec<Delivery>, StoreError> {
    let sql = concat!(
        "SELECT ",
        delivery_columns!(),
        " FROM webhook_delivery AS d WHERE d.webhook = ?1 AND d.id < ?2
         ORDER BY d.id DESC LIMIT ?3"
    );
    let rows = sqlx::query(sql)
        .bind(i64::try_from(webhook).unwrap_or(i64::MAX))
        .bind(before.unwrap_or(i64::MAX))
        .bind(i64::from(limit))
        .fetch_all(pool)
        .await
        .map_err(StoreError::database("read a webhook's deliveries"))?;
    rows.iter().map(delivery_of).collect()
}

/// The oldest delivery of each webhook that is due.
pub(super) async fn due(pool: &SqlitePool, now_ns: i64) -> Result<Vec<DueDelivery>, StoreError> {
    let sql = concat!(
        "SELECT ",
        delivery_columns!(),
        ", w.id, w.record, w.secret
         FROM webhook_delivery AS d JOIN webhook AS w ON w.id = d.webhook
         WHERE d.id IN (SELECT min(id) FROM webhook_delivery
             WHERE state = 'waiting' AND (due_ns <= ?1 OR due_ns > ?2) GROUP BY webhook)
         ORDER BY d.id"
    );
    let longest_ns = i64::try_from(limits::WEBHOOK_BACKOFF_MAX.as_nanos()).unwrap_or(i64::MAX);
    let rows = sqlx::query(sql)
        .bind(now_ns)
        .bind(now_ns.saturating_add(longest_ns))
        .fetch_all(pool)
        .await
        .map_err(StoreError::database("read what is to be told"))?;
    let due = |row: &SqliteRow| {
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

/// How many deliveries wait.
pub(super) async fn waiting(pool: &SqlitePool) -> Result<u64, StoreError> {
    let count = sqlx::query_scalar("SELECT count(*) FROM webhook_delivery WHERE state = 'waiting'")
        .fetch_one(pool)
        .await
        .map_err(StoreError::database("count what is to be told"))?;
    number(count)
}

fn webhook_of(row: &SqliteRow) -> Result<Webhook, StoreError> {
    let record: String = column(row, "webhook", 1)?;
    let webhook: Webhook = parsed("webhook", &record)?;
    Ok(Webhook {
        id: number(column(row, "webhook", 0)?)?,
        ..webhook
    })
}

fn delivery_of(row: &SqliteRow) -> Result<Delivery, StoreError> {
    let unknown = |what: &str, name: &str| StoreError::Corrupt {
        table: TABLE,
        reason: format!("{what} {name:?} is unknown"),
    };
    let event: String = column(row, TABLE, 3)?;
    let state: String = column(row, TABLE, 6)?;
    let attempts_made: i64 = column(row, TABLE, 8)?;
    let attempts: String = column(row, TABLE, 9)?;
    Ok(Delivery {
        id: number(column(row, TABLE, 0)?)?,
        webhook: number(column(row, TABLE, 1)?)?,
        message: column(row, TABLE, 2)?,
        event: WebhookEvent::parse(&event).ok_or_else(|| unknown("event", &event))?,
        body: column(row, TABLE, 4)?,
        created_ns: column(row, TABLE, 5)?,
        state: DeliveryState::parse(&state).ok_or_else(|| unknown("state", &state))?,
        due_ns: column(row, TABLE, 7)?,
        attempts_made: u32::try_from(attempts_made).unwrap_or(u32::MAX),
        attempts: parsed(TABLE, &attempts)?,
        finished_ns: column(row, TABLE, 10)?,
    })
}

fn number(number: i64) -> Result<u64, StoreError> {
    u64::try_from(number).map_err(|_| StoreError::Corrupt {
        table: TABLE,
        reason: format!("{number} is no number of a record"),
    })
}
