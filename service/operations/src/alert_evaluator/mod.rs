//! Keeps watch: each second it holds every robot against the rules of [`fleetcal_domain::alert`] and takes
//! what has changed to the store.

mod duty;
mod standings;
#[cfg(test)]
mod tests;
mod write;

use fleetcal_model::{AlertId, Version, WallTime};
pub use standings::Standings;
pub use write::{Acknowledge, AlertChange, Observe};

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use fleetcal_clock::SharedClock;
use fleetcal_cluster::Membership;
use fleetcal_domain::access::Actor;
use fleetcal_domain::alert::{Alert, AlertKind, AlertPolicy, Condition, ConditionName, Subject};
use fleetcal_fleet::FleetHandle;
use fleetcal_fleet::live::LiveUpdate;
use fleetcal_store::{Store, StoreError};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::Boxed;
use crate::lifecycle::Lifecycle;

/// What an alert evaluator works with.
#[derive(Debug)]
pub struct AlertEvaluatorSetup {
    /// Where alerts are kept.
    pub store: Store,
    /// The robots.
    pub fleet: FleetHandle,
    /// Their records.
    pub lifecycle: Lifecycle,
    /// Where time comes from.
    pub clock: SharedClock,
    /// What is alerted, and after how long.
    pub policy: AlertPolicy,
    /// Whether another instance may have this duty.
    pub membership: Membership,
}

#[derive(Debug)]
struct Inner {
    store: Store,
    fleet: FleetHandle,
    lifecycle: Lifecycle,
    clock: SharedClock,
    policy: Arc<AlertPolicy>,
    membership: Membership,
    active: Mutex<BTreeMap<(Subject, AlertKind), Alert>>,
    since_ns: WallTime,
    stop: CancellationToken,
    tasks: TaskTracker,
}

/// The alert evaluator, cheap to clone.
#[derive(Debug, Clone)]
pub struct AlertEvaluator {
    inner: Arc<Inner>,
}

impl AlertEvaluator {
    /// Reads the alerts that are active and begins to watch.
    ///
    /// # Errors
    /// The database's failure.
    pub fn start(setup: AlertEvaluatorSetup) -> Boxed<Result<Self, StoreError>> {
        Box::pin(Self::started(setup))
    }

    async fn started(setup: AlertEvaluatorSetup) -> Result<Self, StoreError> {
        let active = setup.store.active_alerts().await?;
        let since_ns = setup.clock.now();
        let active = active
            .into_iter()
            .map(|alert| ((alert.robot.clone(), alert.kind), alert));
        let evaluator = Self {
            inner: Arc::new(Inner {
                store: setup.store,
                fleet: setup.fleet,
                lifecycle: setup.lifecycle,
                clock: setup.clock,
                policy: Arc::new(setup.policy),
                membership: setup.membership,
                active: Mutex::new(active.collect()),
                since_ns,
                stop: CancellationToken::new(),
                tasks: TaskTracker::new(),
            }),
        };
        // From before the first look on, or a fault between the two would be lost.
        let live = evaluator.inner.fleet.live();
        evaluator
            .inner
            .tasks
            .spawn(duty::watch(evaluator.clone(), live));
        Ok(evaluator)
    }

    /// Ends the watch. A change that is under way is finished.
    pub async fn stop(&self) {
        self.inner.stop.cancel();
        self.inner.tasks.close();
        self.inner.tasks.wait().await;
    }

    /// Reads the active alerts, of which another instance takes care, and tells listeners what has
    /// changed.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn read_again(&self) -> Result<(), StoreError> {
        let stored = self.inner.store.active_alerts().await?;
        let now = self.inner.clock.now();
        let of_subject = |alert: Alert| ((alert.robot.clone(), alert.kind), alert);
        let stored: BTreeMap<_, _> = stored.into_iter().map(of_subject).collect();
        let mut left = std::mem::replace(&mut *self.active(), stored.clone());
        let is_news = |(key, alert): (_, Alert)| {
            (left.remove(&key).as_ref() != Some(&alert)).then_some(alert)
        };
        let mut news: Vec<_> = stored.into_iter().filter_map(is_news).collect();
        news.extend(left.into_values().map(|alert| ended(alert, now)));
        for alert in news {
            self.announce(alert);
        }
        Ok(())
    }

    fn announce(&self, alert: Alert) {
        self.inner.fleet.announce(LiveUpdate::Alert {
            robot: alert.robot.robot().cloned(),
            alert: Arc::new(alert),
        });
    }

    /// How many alerts of each kind stand in each condition.
    pub fn counts(&self) -> BTreeMap<(AlertKind, ConditionName), u64> {
        let mut counts = BTreeMap::new();
        for alert in self.active().values() {
            let count = counts
                .entry((alert.kind, alert.condition.name()))
                .or_insert(0);
            *count += 1;
        }
        counts
    }

    /// Somebody takes an alert on; it is committed when this returns.
    ///
    /// # Errors
    /// [`StoreError::Alert`] when it does not fit, or the database's failure; nothing has changed
    /// then.
    pub async fn acknowledge(
        &self,
        id: AlertId,
        version: Version,
        actor: Actor,
        note: Option<String>,
    ) -> Result<Alert, StoreError> {
        let write = Acknowledge {
            id,
            version,
            actor,
            note,
            now: self.inner.clock.now(),
        };
        let alert = self.inner.store.transact(write).await?;
        self.take(&[AlertChange::Kept(Box::new(alert.clone()))]);
        Ok(alert)
    }

    /// Remembers what was committed, and tells every listener.
    fn take(&self, changes: &[AlertChange]) {
        for change in changes {
            let told = match change {
                AlertChange::Kept(alert) => {
                    self.remember(alert);
                    Alert::clone(alert)
                }
                AlertChange::Dropped(alert) => {
                    self.forget(alert);
                    ended(Alert::clone(alert), self.inner.clock.now())
                }
            };
            self.announce(told);
        }
    }

    fn remember(&self, alert: &Alert) {
        let key = (alert.robot.clone(), alert.kind);
        let mut active = self.active();
        // An answer that was overtaken by a later one says nothing new.
        let is_later = active
            .get(&key)
            .is_some_and(|known| place(known) > place(alert));
        if is_later {
            return;
        }
        if alert.is_active() {
            active.insert(key, alert.clone());
        } else if active.get(&key).is_some_and(|known| known.id == alert.id) {
            active.remove(&key);
        }
    }

    fn forget(&self, alert: &Alert) {
        let key = (alert.robot.clone(), alert.kind);
        let mut active = self.active();
        if active.get(&key).is_some_and(|known| known.id == alert.id) {
            active.remove(&key);
        }
    }

    /// The map is whole after every statement, so the panic of another thread leaves nothing half
    /// done.
    fn active(&self) -> MutexGuard<'_, BTreeMap<(Subject, AlertKind), Alert>> {
        self.inner
            .active
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

/// An alert that came to its end at this time.
fn ended(alert: Alert, since_ns: WallTime) -> Alert {
    Alert {
        version: alert.version.next(),
        condition: Condition::Normal { since_ns },
        ended_ns: Some(since_ns),
        ..alert
    }
}

/// Which of two writes of an alert is the later one: its version, and within one its words.
const fn place(alert: &Alert) -> (AlertId, Version, WallTime) {
    (alert.id, alert.version, alert.told_ns)
}
