//! Webhooks and their deliveries as the store keeps them.

use fleetcal_domain::webhook::{Delivery, Secret, WebhookUrl};

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
