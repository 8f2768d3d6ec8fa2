//! Webhooks and their deliveries as the store keeps them.

use fleetcal_domain::access::Actor;
use fleetcal_domain::webhook::{Attempt, Delivery, Secret, Webhook, WebhookEvent, WebhookUrl};

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
