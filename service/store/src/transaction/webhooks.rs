//! Webhooks and their deliveries.

use async_trait::async_trait;
use fleetcal_domain::webhook::{Delivery, Secret, Webhook};
use fleetcal_model::{DeliveryId, WallTime, WebhookId};

use crate::error::StoreError;

/// Webhooks and their deliveries; errors as in [`super::Records`].
#[async_trait]
pub trait WebhookRecords {
    /// Reads every webhook with the secret of its messages, oldest first.
    async fn webhooks(&mut self) -> Result<Vec<(Webhook, Secret)>, StoreError>;

    /// Adds a webhook; returns its number.
    async fn add_webhook(
        &mut self,
        webhook: &Webhook,
        secret: &Secret,
    ) -> Result<WebhookId, StoreError>;

    /// Deletes a webhook with its deliveries.
    async fn delete_webhook(&mut self, id: WebhookId) -> Result<(), StoreError>;

    /// Reads one delivery.
    async fn delivery(&mut self, id: DeliveryId) -> Result<Option<Delivery>, StoreError>;

    /// Adds a delivery, whose number is ignored.
    async fn add_delivery(&mut self, delivery: &Delivery) -> Result<(), StoreError>;

    /// Updates an existing delivery.
    async fn save_delivery(&mut self, delivery: &Delivery) -> Result<(), StoreError>;

    /// Gives up all but the latest `kept` waiting deliveries of a webhook; returns their number.
    async fn give_up_deliveries(
        &mut self,
        webhook: WebhookId,
        kept: u32,
        now: WallTime,
    ) -> Result<u64, StoreError>;

    /// Deletes all but the latest `kept` finished deliveries of a webhook.
    async fn forget_deliveries(&mut self, webhook: WebhookId, kept: u32) -> Result<(), StoreError>;
}
