//! Requests for webhooks and their deliveries.

use fleetcal_domain::webhook::{Delivery, Webhook};
use fleetcal_model::{WallTime, WebhookId};

use crate::Store;
use crate::error::StoreError;
use crate::webhooks::DueDelivery;

impl Store {
    /// Every webhook, oldest first.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn webhooks(&self) -> Result<Vec<Webhook>, StoreError> {
        self.shared.reader.webhooks().await
    }

    /// Deliveries of a webhook before number `before`, newest first.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn deliveries(
        &self,
        webhook: WebhookId,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<Delivery>, StoreError> {
        self.shared.reader.deliveries(webhook, before, limit).await
    }

    /// Oldest delivery of each webhook that is due at `now`, or whose wait exceeds the longest one
    /// because the clock was set back.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn due_deliveries(&self, now: WallTime) -> Result<Vec<DueDelivery>, StoreError> {
        self.shared.reader.due_deliveries(now).await
    }

    /// Number of waiting deliveries.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn waiting_deliveries(&self) -> Result<u64, StoreError> {
        self.shared.reader.waiting_deliveries().await
    }
}
