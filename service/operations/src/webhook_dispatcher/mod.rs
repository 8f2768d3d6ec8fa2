//! Webhook dispatcher: it sends the messages of the outbox, one message of each receiver at a time,
//! so that a slow receiver does not delay the others.
//!
//! A sent message is recorded afterwards: after a kill between the two it is sent again, with the
//! same `webhook-id`.

pub(crate) mod outbox;
mod post;
mod write;

#[cfg(test)]
mod tests;

use std::collections::HashSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use fleetcal_clock::SharedClock;
use fleetcal_cluster::{Duty, Membership};
use fleetcal_domain::limits;
use fleetcal_domain::webhook::{Attempt, DeliveryState};
use fleetcal_model::WebhookId;
use fleetcal_store::{DueDelivery, Store, StoreError};
use tokio::task::JoinSet;
use tokio::time::MissedTickBehavior;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

pub use write::{CreateWebhook, DeleteWebhook, NoteAttempt};

use crate::entropy::NoEntropy;
use post::Post;

/// Parts that a webhook dispatcher uses.
#[derive(Debug)]
pub struct WebhookDispatcherSetup {
    /// Store of the outbox.
    pub store: Store,
    /// Clock of the service.
    pub clock: SharedClock,
    /// Random numbers from 0 to 1.
    pub jitter: fn() -> Result<f64, NoEntropy>,
    /// Membership in a cluster, in which another instance may have this duty.
    pub membership: Membership,
}

/// Counters of a webhook dispatcher since it was started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct WebhookDispatcherCounters {
    /// Messages that a receiver has accepted.
    pub delivered: u64,
    /// Attempts that failed.
    pub failed_attempts: u64,
    /// Messages that were given up.
    pub given_up: u64,
}

#[derive(Debug, Default)]
struct Counts {
    delivered: AtomicU64,
    failed_attempts: AtomicU64,
    given_up: AtomicU64,
}

#[derive(Debug)]
struct Inner {
    store: Store,
    clock: SharedClock,
    jitter: fn() -> Result<f64, NoEntropy>,
    membership: Membership,
    post: Post,
    counts: Counts,
    stop: CancellationToken,
    tasks: TaskTracker,
}

/// Webhook dispatcher, cheap to clone.
#[derive(Debug, Clone)]
pub struct WebhookDispatcher {
    inner: Arc<Inner>,
}

impl WebhookDispatcher {
    /// Begins to send the waiting messages.
    pub fn start(setup: WebhookDispatcherSetup) -> Self {
        let dispatcher = Self {
            inner: Arc::new(Inner {
                store: setup.store,
                clock: setup.clock,
                jitter: setup.jitter,
                membership: setup.membership,
                post: Post::new(),
                counts: Counts::default(),
                stop: CancellationToken::new(),
                tasks: TaskTracker::new(),
            }),
        };
        dispatcher.inner.tasks.spawn(dispatcher.clone().run());
        dispatcher
    }

    /// Ends the sending. An attempt that is under way is aborted, and repeated after the next
    /// start.
    pub async fn stop(&self) {
        self.inner.stop.cancel();
        self.inner.tasks.close();
        self.inner.tasks.wait().await;
    }

    /// Counters since the start.
    pub fn counters(&self) -> WebhookDispatcherCounters {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let counts = &self.inner.counts;
        WebhookDispatcherCounters {
            delivered: read(&counts.delivered),
            failed_attempts: read(&counts.failed_attempts),
            given_up: read(&counts.given_up),
        }
    }

    async fn run(self) {
        let mut ticks = tokio::time::interval(limits::WEBHOOK_LOOK_EVERY);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut busy = HashSet::new();
        let mut under_way = JoinSet::new();
        loop {
            tokio::select! {
                () = self.inner.stop.cancelled() => break,
                Some(done) = under_way.join_next() => match done {
                    Ok(webhook) => {
                        busy.remove(&webhook);
                    }
                    Err(error) => {
                        tracing::error!(%error, "an attempt at a delivery failed");
                        // Which one it was is not said; none is sent to twice meanwhile.
                        if under_way.is_empty() {
                            busy.clear();
                        }
                    }
                },
                _ = ticks.tick() => {}
            }
            let membership = &self.inner.membership;
            let is_own = membership.does(Duty::Webhooks);
            if !is_own || !membership.may_act(self.inner.clock.uptime()) {
                continue;
            }
            let now = self.inner.clock.now();
            let due = match self.inner.store.due_deliveries(now).await {
                Ok(due) => due,
                Err(error) => {
                    tracing::error!(%error, "the due deliveries could not be read");
                    continue;
                }
            };
            for one in due {
                if busy.insert(one.delivery.webhook) {
                    under_way.spawn(self.clone().deliver(one));
                }
            }
        }
        under_way.shutdown().await;
    }

    /// Tries a delivery once; returns its webhook, whose turn is over.
    async fn deliver(self, due: DueDelivery) -> WebhookId {
        let webhook = due.delivery.webhook;
        let attempt = self.attempt(&due).await;
        if let Err(error) = self.write_down(&due, attempt).await {
            tracing::error!(%error, "an attempt at a delivery was not stored");
            // Not at once again: the database is in trouble.
            tokio::time::sleep(limits::WEBHOOK_LOOK_EVERY).await;
        }
        webhook
    }

    async fn attempt(&self, due: &DueDelivery) -> Attempt {
        let (at_ns, began) = (self.inner.clock.now(), self.inner.clock.elapsed());
        let answer = self.inner.post.send(due, at_ns.whole_s()).await;
        let took = self.inner.clock.elapsed().saturating_sub(began);
        let (status, error) = match answer {
            Ok(status) => (Some(status), None),
            Err(error) => {
                let error: String = error.to_string();
                let kept = error.chars().take(limits::WEBHOOK_ERROR_CHARS_MAX);
                (None, Some(kept.collect()))
            }
        };
        Attempt {
            at_ns,
            took_ms: u64::try_from(took.as_millis()).unwrap_or(u64::MAX),
            status,
            error,
        }
    }

    async fn write_down(&self, due: &DueDelivery, attempt: Attempt) -> Result<(), StoreError> {
        let counts = &self.inner.counts;
        let taken = attempt.is_taken();
        let noted = NoteAttempt {
            delivery: due.delivery.id,
            attempt,
            now: self.inner.clock.now(),
            jitter: self.jitter(),
        };
        let noted = self.inner.store.transact(noted).await?;
        let count = if taken {
            &counts.delivered
        } else {
            &counts.failed_attempts
        };
        count.fetch_add(1, Ordering::Relaxed);
        if let Some(delivery) = noted
            && delivery.state == DeliveryState::GivenUp
        {
            counts.given_up.fetch_add(1, Ordering::Relaxed);
            let webhook = due.delivery.webhook;
            tracing::error!(%webhook, message = %due.delivery.message, "a message was given up");
        }
        Ok(())
    }

    /// Random number from 0 to 1; 0.5 if the generator fails.
    fn jitter(&self) -> f64 {
        (self.inner.jitter)().unwrap_or_else(|error| {
            tracing::warn!(%error, "no random number could be drawn");
            0.5
        })
    }
}
