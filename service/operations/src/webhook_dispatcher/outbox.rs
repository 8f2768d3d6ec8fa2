//! Outbox of messages to webhooks, until each was sent.

use fleetcal_domain::limits;
use fleetcal_domain::webhook::{Delivery, Message};
use fleetcal_model::{WallTime, WebhookId};
use fleetcal_store::{Records, StoreError};

/// Adds a message to the outbox of every webhook that receives its event; the transaction is that
/// of the reported change.
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

/// Gives up the oldest waiting deliveries beyond the limit, and deletes the oldest finished ones
/// beyond theirs.
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

/// Error for a message that cannot be written as JSON.
pub(crate) fn unwritable(error: &serde_json::Error) -> StoreError {
    StoreError::Corrupt {
        table: "webhook_delivery",
        reason: error.to_string(),
    }
}
