//! Outbox of messages to webhooks, until each was sent.

use fleetcal_domain::limits;
use fleetcal_domain::webhook::{Delivery, Message};
use fleetcal_model::{WallTime, WebhookId};
use fleetcal_store::{Records, StoreError};

/// Puts a message into the outbox of every webhook that is told of its event; the transaction is
/// the one of the change that it tells.
pub(crate) async fn tell(
    records: &mut dyn Records,
    message: &Message,
    now: WallTime,
) -> Result<(), StoreError> {
    for (webhook, secret) in records.webhooks().await? {
        if !webhook.events.contains(&message.event) {
            continue;
        }
        let delivery = Delivery::new(webhook.id, &secret, message, now);
        records.add_delivery(&delivery).await?;
        keep_within_limits(records, webhook.id, now).await?;
    }
    Ok(())
}

/// Gives up the oldest of too many that wait, and forgets the oldest of too many that are done.
pub(super) async fn keep_within_limits(
    records: &mut dyn Records,
    webhook: WebhookId,
    now: WallTime,
) -> Result<(), StoreError> {
    let waiting = limits::WEBHOOK_WAITING_MAX;
    let lost = records.give_up_deliveries(webhook, waiting, now).await?;
    if lost > 0 {
        tracing::error!(%webhook, lost, "too many messages wait, the oldest are lost");
    }
    records
        .forget_deliveries(webhook, limits::WEBHOOK_LOG_MAX)
        .await
}

/// A message that cannot be written as JSON.
pub(crate) fn unwritable(error: &serde_json::Error) -> StoreError {
    StoreError::Corrupt {
        table: "webhook_delivery",
        reason: error.to_string(),
    }
}
