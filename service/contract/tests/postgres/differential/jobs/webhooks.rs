//! Webhooks and their deliveries.

use std::fmt::Write as _;

use fleetcal_domain::webhook::{
    Attempt, Delivery, DeliveryState, Message, Secret, Webhook, WebhookEvent, WebhookUrl,
};
use fleetcal_model::{DeliveryId, WebhookId};
use fleetcal_store::StoreError;
use rand::Rng;

use super::super::chance::{pick, time, words};
use super::{Run, ask};

impl Run<'_> {
    fn some_webhook(&mut self) -> WebhookId {
        WebhookId(self.chance.random_range(0..4))
    }

    pub(super) async fn add_webhook(&mut self) -> Result<(), StoreError> {
        let present = ask!(self, webhooks());
        let chance = &mut self.chance;
        let url = format!("https://example.org/{}", chance.random_range(0..5));
        let url = WebhookUrl::parse(&url).unwrap();
        let secret = Secret::from_bytes(chance.random::<[u8; 24]>().to_vec());
        let webhook = Webhook {
            id: WebhookId(0),
            url,
            events: WebhookEvent::ALL.to_vec(),
            created_by: words(chance),
            created_ns: time(chance),
        };
        if present.iter().all(|(known, _)| known.url != webhook.url) {
            ask!(self, add_webhook(&webhook, &secret));
        }
        Ok(())
    }

    pub(super) async fn delete_webhook(&mut self) -> Result<(), StoreError> {
        let id = self.some_webhook();
        ask!(self, delete_webhook(id));
        ask!(self, webhooks());
        Ok(())
    }

    pub(super) async fn add_delivery(&mut self) -> Result<(), StoreError> {
        let id = self.some_webhook();
        let present = ask!(self, webhooks());
        let Some((_, secret)) = present.iter().find(|(webhook, _)| webhook.id == id) else {
            return Ok(());
        };
        let chance = &mut self.chance;
        let message = Message {
            event: pick(chance, &WebhookEvent::ALL),
            subject: words(chance),
            body: serde_json::json!({"said": words(chance)}).to_string(),
        };
        let delivery = Delivery::new(id, secret, &message, time(chance));
        ask!(self, add_delivery(&delivery));
        Ok(())
    }

    pub(super) async fn save_delivery(&mut self) -> Result<(), StoreError> {
        let id = DeliveryId(self.chance.random_range(0..6));
        let Some(before) = ask!(self, delivery(id)) else {
            return Ok(());
        };
        let chance = &mut self.chance;
        let now = time(chance);
        let attempt = Attempt {
            at_ns: now,
            took_ms: chance.random_range(0..9_000),
            status: chance.random_bool(0.5).then_some(500),
            error: Some(words(chance)),
        };
        let mut after = before.after(attempt, now, chance.random());
        if chance.random_bool(0.4) {
            after.state = pick(chance, DeliveryState::ALL);
        }
        ask!(self, save_delivery(&after));
        ask!(self, delivery(id));
        Ok(())
    }

    pub(super) async fn drop_deliveries(&mut self) -> Result<(), StoreError> {
        let (id, now) = (self.some_webhook(), self.now);
        let kept = self.chance.random_range(0..3);
        ask!(self, give_up_deliveries(id, kept, now));
        ask!(self, forget_deliveries(id, kept));
        Ok(())
    }
}
