//! Webhooks and their deliveries.

use async_trait::async_trait;
use fleetcal_domain::webhook::{Delivery, Secret, Webhook};
use fleetcal_model::{DeliveryId, WallTime, WebhookId};

use crate::error::StoreError;

/// Webhooks and their deliveries; errors as in [`super::Records`].
#[async_trait]
pub trait WebhookRecords {
    /// Every webhook with what its messages are signed with, oldest first.
    async fn webhooks(&mut self) -> Result<Vec<(Webhook, Secret)>, StoreError>;

    /// Adds a webhook; gives its number.
    async fn add_webhook(
        &mut self,
        webhook: &Webhook,
        secret: &Secret,
    ) -> Result<WebhookId, StoreError>;

    /// Deletes a webhook with its deliveries.
    async fn delete_webhook(&mut self, id: WebhookId) -> Result<(), StoreError>;

    /// One delivery.
    async fn delivery(&mut self, id: DeliveryId) -> Result<Option<Delivery>, StoreError>;

    /// Adds a delivery, whose number does not count.
    async fn add_delivery(&mut self, delivery: &Delivery) -> Result<(), StoreError>;

    /// Keeps a delivery that is there.
    async fn save_delivery(&mut self, delivery: &Delivery) -> Result<(), StoreError>;

    /// Gives up all but the latest `kept` deliveries of a webhook that wait; gives their number.
    async fn give_up_deliveries(
        &mut self,
        webhook: WebhookId,
        kept: u32,
        now: WallTime,
    ) -> Result<u64, StoreError>;

    /// Deletes all but the latest `kept` deliveries of a webhook that do not wait.
    async fn forget_deliveries(&mut self, webhook: WebhookId, kept: u32) -> Result<(), StoreError>;
}
