//! Webhooks and their deliveries in the store.

use fleetcal_domain::webhook::{Delivery, Secret, WebhookUrl};

/// Delivery that is due, with the address and secret to send it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DueDelivery {
    /// Due delivery.
    pub delivery: Delivery,
    /// Address of the receiver.
    pub url: WebhookUrl,
    /// Secret that signs the message.
    pub secret: Secret,
}
