//! Changes of webhooks and of deliveries to them.

use async_trait::async_trait;
use fleetcal_domain::access::Actor;
use fleetcal_domain::audit::Action;
use fleetcal_domain::webhook::{
    Attempt, Delivery, Secret, Webhook, WebhookEvent, WebhookRefused, WebhookUrl, allow_new_webhook,
};
use fleetcal_model::{DeliveryId, WallTime, WebhookId};
use fleetcal_store::{AuditEntry, Job, Records, StoreError};
use serde_json::Value;

use super::outbox::keep_within_limits;

/// Job that creates a webhook.
#[derive(Debug, Clone)]
pub struct CreateWebhook {
    /// Address of the receiver.
    pub url: WebhookUrl,
    /// Events that it receives.
    pub events: Vec<WebhookEvent>,
    /// Secret that signs its messages.
    pub secret: Secret,
    /// Actor of the change.
    pub actor: Actor,
    /// Wall time.
    pub now: WallTime,
}

/// Job that deletes a webhook.
#[derive(Debug, Clone)]
pub struct DeleteWebhook {
    /// Number of the webhook.
    pub id: WebhookId,
    /// Actor of the change.
    pub actor: Actor,
    /// Wall time.
    pub now: WallTime,
}

/// Job that records an attempt at a delivery.
#[derive(Debug, Clone)]
pub struct NoteAttempt {
    /// Number of the delivery.
    pub delivery: DeliveryId,
    /// Attempt with its result.
    pub attempt: Attempt,
    /// Wall time of its end.
    pub now: WallTime,
    /// A random number from 0 to 1.
    pub jitter: f64,
}

#[async_trait]
impl Job for CreateWebhook {
    type Done = Webhook;

    async fn run(&self, records: &mut dyn Records) -> Result<Webhook, StoreError> {
        let present = records.webhooks().await?;
        allow_new_webhook(present.iter().map(|(webhook, _)| webhook), &self.url)?;
        let mut webhook = Webhook {
            id: WebhookId(0),
            url: self.url.clone(),
            events: self.events.clone(),
            created_by: self.actor.name.clone(),
            created_ns: self.now,
        };
        webhook.id = records.add_webhook(&webhook, &self.secret).await?;
        let after = Some(webhook.audited());
        let entry = AuditEntry {
            after,
            ..entry(Action::CreateWebhook, &webhook, &self.actor, self.now)
        };
        records.append_audit(&entry).await?;
        Ok(webhook)
    }
}

#[async_trait]
impl Job for DeleteWebhook {
    type Done = Webhook;

    async fn run(&self, records: &mut dyn Records) -> Result<Webhook, StoreError> {
        let mut present = records.webhooks().await?.into_iter();
        let found = present.find(|(webhook, _)| webhook.id == self.id);
        let (webhook, _) = found.ok_or(WebhookRefused::Unknown(self.id))?;
        records.delete_webhook(webhook.id).await?;
        let before: Option<Value> = Some(webhook.audited());
        let entry = AuditEntry {
            before,
            ..entry(Action::DeleteWebhook, &webhook, &self.actor, self.now)
        };
        records.append_audit(&entry).await?;
        Ok(webhook)
    }
}

fn entry(action: Action, webhook: &Webhook, actor: &Actor, now: WallTime) -> AuditEntry {
    AuditEntry {
        at_ns: now,
        actor: actor.clone(),
        action,
        subject_id: webhook.id.to_string(),
        robot: None,
        before: None,
        after: None,
        reason: None,
    }
}

#[async_trait]
impl Job for NoteAttempt {
    /// Delivery after the attempt; `None` if its webhook is deleted.
    type Done = Option<Delivery>;

    async fn run(&self, records: &mut dyn Records) -> Result<Option<Delivery>, StoreError> {
        let Some(before) = records.delivery(self.delivery).await? else {
            return Ok(None);
        };
        let after = before.after(self.attempt.clone(), self.now, self.jitter);
        records.save_delivery(&after).await?;
        keep_within_limits(records, after.webhook, self.now).await?;
        Ok(Some(after))
    }
}
