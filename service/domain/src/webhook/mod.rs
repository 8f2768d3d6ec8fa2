//! Webhooks: messages to other programs over HTTP, their signatures and their attempts. Pure: no
//! clock, no randomness, no wire.
//!
//! Messages follow the Standard Webhooks scheme: a JSON body with `type`, `timestamp` and `data`,
//! and the headers `webhook-id`, `webhook-timestamp` and `webhook-signature`.

mod delivery;
mod message;
mod record;
mod signature;

pub use delivery::{Attempt, Delivery, DeliveryState, backoff};
pub use message::Message;
pub use record::{Webhook, WebhookEvent, WebhookRefused, WebhookUrl, allow_new_webhook};
pub use signature::Secret;
