//! Alert evaluator: it evaluates the rules of [`fleetcal_domain::alert`] for every robot each
//! second and passes changes to the store.

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
use crate::alert_evaluator::write::AcknowledgeAll;
use crate::lifecycle::Lifecycle;

/// Parts that an alert evaluator uses.
#[derive(Debug)]
pub struct AlertEvaluatorSetup {
    /// Store of the alerts.
    pub store: Store,
    /// Robots of the fleet.
    pub fleet: FleetHandle,
    /// Records of the robots.
    pub lifecycle: Lifecycle,
    /// Clock of the service.
    pub clock: SharedClock,
    /// Policy of alerts: kinds in use, and their delays.
    pub policy: AlertPolicy,
    /// Membership in a cluster, in which another instance may have this duty.
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

/// Alert evaluator, cheap to clone.
#[derive(Debug, Clone)]
pub struct AlertEvaluator {
    inner: Arc<Inner>,
}

impl AlertEvaluator {
    /// Reads the active alerts and begins to evaluate.
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

    /// Ends the evaluation. A change that is under way is finished.
    pub async fn stop(&self) {
        self.inner.stop.cancel();
        self.inner.tasks.close();
        self.inner.tasks.wait().await;
    }

    /// Reads the active alerts, which another instance evaluates, and publishes changes to
    /// listeners.
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

    /// Number of alerts by kind and condition.
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

    /// Acknowledges alerts in the versions that a person read, all or none; the acknowledgements
    /// are committed when this returns.
    ///
    /// # Errors
    /// [`StoreError::Alert`] if one does not fit, or the database's failure; nothing has changed
    /// then.
    pub async fn acknowledge(
        &self,
        alerts: &[(AlertId, Version)],
        actor: &Actor,
        note: Option<&str>,
    ) -> Result<Vec<Alert>, StoreError> {
        let now = self.inner.clock.now();
        let each = alerts.iter().map(|&(id, version)| Acknowledge {
            id,
            version,
            actor: actor.clone(),
            note: note.map(str::to_owned),
            now,
        });
        let write = AcknowledgeAll(each.collect());
        let alerts = self.inner.store.transact(write).await?;
        let changes = alerts.iter().cloned().map(Box::new);
        let changes: Vec<_> = changes.map(AlertChange::Kept).collect();
        self.take(&changes);
        Ok(alerts)
    }

    /// Stores the committed changes, and publishes them to every listener.
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

    /// Lock of the active alerts. The map is consistent after every statement, so that the panic of
    /// another thread leaves no partial change.
    fn active(&self) -> MutexGuard<'_, BTreeMap<(Subject, AlertKind), Alert>> {
        self.inner
            .active
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

/// Alert that ended at this time.
fn ended(alert: Alert, since_ns: WallTime) -> Alert {
    Alert {
        version: alert.version.next(),
        condition: Condition::Normal { since_ns },
        ended_ns: Some(since_ns),
        ..alert
    }
}

/// Order of two writes of an alert: by version, and within one by the time of the description.
const fn place(alert: &Alert) -> (AlertId, Version, WallTime) {
    (alert.id, alert.version, alert.told_ns)
}
