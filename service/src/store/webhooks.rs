//! Webhooks and their deliveries as the store keeps them.

use super::Store;
use super::error::StoreError;
use super::writer::Command;
use crate::access::Actor;
use crate::webhook::{Attempt, Delivery, Secret, Webhook, WebhookEvent, WebhookUrl};

/// A change of a webhook or of a delivery.
#[derive(Debug, Clone)]
pub enum WebhookWrite {
    /// A new one.
    Create(CreateWrite),
    /// One goes, with what was to be told to it.
    Delete(DeleteWrite),
    /// A delivery was tried.
    Attempted(AttemptWrite),
}

/// A new webhook.
#[derive(Debug, Clone)]
pub struct CreateWrite {
    /// Where messages go.
    pub url: WebhookUrl,
    /// What it is told of.
    pub events: Vec<WebhookEvent>,
    /// What its messages are signed with.
    pub secret: Secret,
    /// Who makes it.
    pub actor: Actor,
    /// Wall time.
    pub now_ns: i64,
}

/// A webhook that goes.
#[derive(Debug, Clone)]
pub struct DeleteWrite {
    /// Which.
    pub id: u64,
    /// Who takes it away.
    pub actor: Actor,
    /// Wall time.
    pub now_ns: i64,
}

/// An attempt at a delivery.
#[derive(Debug, Clone)]
pub struct AttemptWrite {
    /// Which delivery.
    pub delivery: u64,
    /// What came of it.
    pub attempt: Attempt,
    /// Wall time of its end.
    pub now_ns: i64,
    /// A random number from 0 to 1.
    pub jitter: f64,
}

/// What became of a [`WebhookWrite`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum WebhookWritten {
    /// The webhook that is new, or is gone.
    Webhook(Box<Webhook>),
    /// The delivery as it stands now; `None` when its webhook is gone.
    Delivery(Option<Box<Delivery>>),
}

/// A delivery that is due, with what it takes to send it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DueDelivery {
    /// The delivery.
    pub delivery: Delivery,
    /// Where it goes.
    pub url: WebhookUrl,
    /// What it is signed with.
    pub secret: Secret,
}

impl Store {
    /// Changes a webhook or a delivery and waits until that is committed.
    ///
    /// # Errors
    /// [`StoreError::Webhook`] when it is refused; otherwise the database's failure.
    pub async fn write_webhook(&self, write: WebhookWrite) -> Result<WebhookWritten, StoreError> {
        self.ask(|reply| Command::Webhook(Box::new(write), reply))
            .await
    }

    /// Every webhook, oldest first.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn webhooks(&self) -> Result<Vec<Webhook>, StoreError> {
        self.shared.reader.webhooks().await
    }

    /// A webhook's deliveries before number `before`, newest first.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn deliveries(
        &self,
        webhook: u64,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<Delivery>, StoreError> {
        self.shared.reader.deliveries(webhook, before, limit).await
    }

    /// The oldest delivery of each webhook that is due at `now_ns`, or that a clock which was set
    /// back would make wait for longer than there is to wait.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn due_deliveries(&self, now_ns: i64) -> Result<Vec<DueDelivery>, StoreError> {
        self.shared.reader.due_deliveries(now_ns).await
    }

    /// How many deliveries wait.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn waiting_deliveries(&self) -> Result<u64, StoreError> {
        self.shared.reader.waiting_deliveries().await
    }
}
