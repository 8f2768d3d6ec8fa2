//! Documents of webhooks and of their deliveries.

use fleetcal_domain::timestamp as time;
use fleetcal_domain::webhook::{Attempt, Delivery, DeliveryState, Webhook, WebhookEvent};
use fleetcal_model::{DeliveryId, WebhookId};
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

/// Receiver of messages.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Webhook)]
pub struct WebhookDocument {
    /// Number of the webhook.
    id: WebhookId,
    /// Address of the receiver.
    url: String,
    /// Events that it receives.
    events: Vec<WebhookEvent>,
    /// Person or tool that created it.
    created_by: String,
    #[schema(value_type = String, format = DateTime)]
    created: Timestamp,
}

impl WebhookDocument {
    /// Makes the document of a webhook.
    pub fn of(webhook: Webhook) -> Self {
        Self {
            id: webhook.id,
            url: webhook.url.into(),
            events: webhook.events,
            created_by: webhook.created_by,
            created: time::of(webhook.created_ns),
        }
    }
}

/// List of every webhook.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct WebhookList {
    /// Every webhook, the oldest first.
    pub items: Vec<WebhookDocument>,
}

/// Webhook to be created.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(as = NewWebhook)]
#[serde(deny_unknown_fields)]
pub struct NewWebhookBody {
    /// Address of the receiver: `http` or `https`, at most 2000 bytes, without user and password.
    /// The service sends from its own network, so a person who may create webhooks can make it send
    /// requests to addresses that only it can reach; it reads the answer's status alone.
    #[schema(max_length = 2000)]
    pub url: String,
    /// Events that it receives; all unless given.
    #[serde(default)]
    pub events: Option<Vec<WebhookEvent>>,
}

/// Webhook with its secret, which is shown this once.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = WebhookWithSecret)]
pub struct SecretDocument {
    /// Created webhook.
    pub webhook: WebhookDocument,
    /// Secret that signs its messages: `whsec_` and base64. The service stores it in plain form,
    /// because it signs with it; it is in the database and in every backup of it.
    pub secret: String,
}

/// Delivery of one message to one receiver.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = WebhookDelivery)]
pub struct DeliveryDocument {
    /// Number of the delivery.
    id: DeliveryId,
    /// Value of the message's `webhook-id`.
    message: String,
    /// Event that the message reports.
    event: WebhookEvent,
    state: DeliveryState,
    /// Time of the event.
    #[schema(value_type = String, format = DateTime)]
    created: Timestamp,
    /// Time of the next attempt; `null` once it is finished.
    #[schema(value_type = Option<String>, format = DateTime)]
    due: Option<Timestamp>,
    /// Time at which it was delivered or given up.
    #[schema(value_type = Option<String>, format = DateTime)]
    finished: Option<Timestamp>,
    /// Number of attempts made.
    attempts_made: u32,
    /// Latest 20 attempts, the oldest first.
    attempts: Vec<AttemptDocument>,
    /// Body of the message.
    #[schema(value_type = Object)]
    body: serde_json::Value,
}

/// Attempt at a delivery.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = WebhookAttempt)]
struct AttemptDocument {
    #[schema(value_type = String, format = DateTime)]
    time: Timestamp,
    /// Duration of the attempt, ms.
    took_ms: u64,
    /// HTTP status of the answer; `null` without an answer.
    status: Option<u16>,
    /// Reason for which there was no answer.
    error: Option<String>,
}

impl DeliveryDocument {
    /// Makes the document of a delivery.
    pub fn of(delivery: Delivery) -> Self {
        let waits = delivery.state == DeliveryState::Waiting;
        let attempt = |attempt: Attempt| AttemptDocument {
            time: time::of(attempt.at_ns),
            took_ms: attempt.took_ms,
            status: attempt.status,
            error: attempt.error,
        };
        Self {
            id: delivery.id,
            message: delivery.message,
            event: delivery.event,
            state: delivery.state,
            created: time::of(delivery.created_ns),
            due: waits.then(|| time::of(delivery.due_ns)),
            finished: delivery.finished_ns.map(time::of),
            attempts_made: delivery.attempts_made,
            attempts: delivery.attempts.into_iter().map(attempt).collect(),
            body: serde_json::from_str(&delivery.body).unwrap_or_default(),
        }
    }
}

/// A page of deliveries, newest first.
#[derive(Serialize, utoipa::ToSchema)]
pub struct DeliveryPage {
    /// Deliveries.
    pub items: Vec<DeliveryDocument>,
    /// Value of `cursor` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next: Option<String>,
}
