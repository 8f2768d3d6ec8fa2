//! Delivery of one message to one receiver.

use std::time::Duration;

use fleetcal_model::{DeliveryId, WallTime, WebhookId};
use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr, VariantArray};

use super::message::Message;
use super::record::WebhookEvent;
use super::signature::Secret;
use crate::limits;

/// State of a delivery.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
    EnumString,
    IntoStaticStr,
    VariantArray,
)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum DeliveryState {
    /// Waiting for its first or next attempt.
    Waiting,
    /// Accepted by the receiver.
    Delivered,
    /// Given up: the receiver did not accept it in time, or too many newer ones wait.
    GivenUp,
}

impl DeliveryState {
    /// Every state.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in documents and in the database.
    pub fn as_str(self) -> &'static str {
        self.into()
    }

    /// Parses the name of a state.
    pub fn parse(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}

/// Attempt at a delivery.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Attempt {
    /// Begin of the attempt, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// Duration of the attempt, ms.
    pub took_ms: u64,
    /// HTTP status of the answer; `None` without an answer.
    pub status: Option<u16>,
    /// Reason for which there was no answer.
    pub error: Option<String>,
}

impl Attempt {
    /// True if the receiver accepted the message; a redirection is not followed.
    pub fn is_taken(&self) -> bool {
        self.status
            .is_some_and(|status| (200..300).contains(&status))
    }
}

/// Delivery of one message to one receiver.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Delivery {
    /// Number of the delivery.
    pub id: DeliveryId,
    /// Webhook of the receiver.
    pub webhook: WebhookId,
    /// `webhook-id` of the message.
    pub message: String,
    /// Event that the message reports.
    pub event: WebhookEvent,
    /// Body, byte for byte.
    pub body: String,
    /// Time of the event, ns since 1970, wall time.
    pub created_ns: WallTime,
    /// State of the delivery.
    pub state: DeliveryState,
    /// Time of the next attempt.
    pub due_ns: WallTime,
    /// Number of attempts made.
    pub attempts_made: u32,
    /// Latest [`limits::WEBHOOK_ATTEMPTS_KEPT`] attempts, oldest first.
    pub attempts: Vec<Attempt>,
    /// Time at which it was delivered or given up.
    pub finished_ns: Option<WallTime>,
}

impl Delivery {
    /// Delivery at `now` of a message for a webhook with this secret. The store assigns the number.
    pub fn new(webhook: WebhookId, secret: &Secret, message: &Message, now: WallTime) -> Self {
        Self {
            id: DeliveryId(0),
            webhook,
            message: secret.message_id(&message.subject),
            event: message.event,
            body: message.body.clone(),
            created_ns: now,
            state: DeliveryState::Waiting,
            due_ns: now,
            attempts_made: 0,
            attempts: Vec::new(),
            finished_ns: None,
        }
    }

    /// The delivery after an attempt that ended at `now`; `jitter` is a random number from 0 to 1.
    /// A delivery that was given up meanwhile stays so, unless the receiver accepted it.
    #[must_use]
    pub fn after(&self, attempt: Attempt, now: WallTime, jitter: f64) -> Self {
        let mut after = self.clone();
        let taken = attempt.is_taken();
        after.attempts_made = self.attempts_made.saturating_add(1);
        after.attempts.push(attempt);
        let surplus = after.attempts.len();
        let surplus = surplus.saturating_sub(limits::WEBHOOK_ATTEMPTS_KEPT);
        after.attempts.drain(..surplus);
        after.due_ns = now.plus(backoff(after.attempts_made, jitter));
        let last = self.created_ns.plus(limits::WEBHOOK_RETRY_FOR);
        after.state = if taken {
            DeliveryState::Delivered
        } else if after.due_ns > last {
            DeliveryState::GivenUp
        } else {
            DeliveryState::Waiting
        };
        after.finished_ns = (after.state != DeliveryState::Waiting).then_some(now);
        if self.state != DeliveryState::Waiting && !taken {
            after.state = self.state;
            after.finished_ns = self.finished_ns;
        }
        after
    }
}

/// Wait after so many attempts: twice as long each time, up to [`limits::WEBHOOK_BACKOFF_MAX`], and
/// shortened at random by up to a half (`jitter`, from 0 to 1), so that many messages do not return
/// at the same moment.
pub fn backoff(attempts_made: u32, jitter: f64) -> Duration {
    let doublings = attempts_made.saturating_sub(1).min(16);
    let whole = limits::WEBHOOK_BACKOFF_FIRST.saturating_mul(1 << doublings);
    let whole = whole.min(limits::WEBHOOK_BACKOFF_MAX);
    whole.mul_f64(1.0 - jitter.clamp(0.0, 1.0) / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    fn delivery() -> Delivery {
        Delivery {
            id: DeliveryId(1),
            webhook: WebhookId(1),
            message: "msg_1".to_owned(),
            event: WebhookEvent::AlertAlerting,
            body: "{}".to_owned(),
            created_ns: WallTime(0),
            state: DeliveryState::Waiting,
            due_ns: WallTime(0),
            attempts_made: 0,
            attempts: Vec::new(),
            finished_ns: None,
        }
    }

    fn attempt(at_ns: WallTime, status: Option<u16>) -> Attempt {
        Attempt {
            at_ns,
            took_ms: 1,
            status,
            error: None,
        }
    }

    #[test]
    fn the_wait_doubles_up_to_an_hour_and_jitter_takes_up_to_a_half() {
        let milliseconds = |made, jitter| backoff(made, jitter).as_millis();
        let first = [1, 2, 3].map(|made| milliseconds(made, 0.0));
        assert_eq!(first, [5_000, 10_000, 20_000]);
        assert_eq!(milliseconds(40, 0.0), 3_600_000);
        assert_eq!(milliseconds(1, 1.0), 2_500);
        assert_eq!(milliseconds(1, 7.0), 2_500);
    }

    #[test]
    fn what_is_not_taken_is_tried_for_a_day_and_then_given_up() {
        for jitter in [0.0, 0.5, 1.0] {
            let mut now = delivery();
            while now.state == DeliveryState::Waiting {
                assert!(now.attempts_made < 100, "it ends");
                now = now.after(attempt(now.due_ns, Some(500)), now.due_ns, jitter);
            }
            assert_eq!(now.state, DeliveryState::GivenUp);
            let last_ns = now.finished_ns.unwrap().0;
            assert!((22 * 3_600 * S..=24 * 3_600 * S).contains(&last_ns));
            assert!(now.attempts.len() <= limits::WEBHOOK_ATTEMPTS_KEPT);
            assert!(now.attempts_made > 25, "{}", now.attempts_made);
        }
    }

    #[test]
    fn only_a_status_of_success_is_taken() {
        for (status, state) in [
            (Some(200), DeliveryState::Delivered),
            (Some(204), DeliveryState::Delivered),
            (Some(301), DeliveryState::Waiting),
            (Some(404), DeliveryState::Waiting),
            (None, DeliveryState::Waiting),
        ] {
            let after = delivery().after(attempt(WallTime(0), status), WallTime(7), 0.0);
            assert_eq!((after.state, after.attempts_made), (state, 1), "{status:?}");
            assert_eq!(after.finished_ns.is_some(), state != DeliveryState::Waiting);
        }
    }
}
