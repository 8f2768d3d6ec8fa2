//! Lifecycle of calibrations: it stores decisions one at a time for each robot, stores robots'
//! answers, and applies due commands each second.
//!
//! Decisions are pure functions of [`fleetcal_domain::approval`] on the records of the store. This
//! is the asynchronous part between them.

mod answers;
mod certificate;
mod cluster;
mod decide;
mod duty;
mod freeze;
mod history;
mod inbox;
mod offer;
mod policy;
mod rollout_duty;
mod rollouts;
#[cfg(test)]
mod tests;

pub use decide::{Decide, Decided, Release};
use fleetcal_model::Version;
pub use freeze::SetFreeze;
pub use offer::OutboxMessage;
pub use policy::SetPolicy;
pub use rollouts::{AdvanceRollout, ChangeRollout, RolloutChange, StartRollout};

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, PoisonError, RwLock};

use fleetcal_clock::SharedClock;
use fleetcal_cluster::Membership;
use fleetcal_domain::access::Actor;
use fleetcal_domain::approval::{
    Command, DeploymentState, Policy, Present, RobotLedger, values_and_sigmas,
};
use fleetcal_domain::robot::{RobotState, WarningKind};
use fleetcal_fleet::budget::LossLog;
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Envelope;
use fleetcal_proto::key_change::{KeyAnnouncement, KeyChanges, ServiceKeys};
use fleetcal_proto::signing::{PublicKey, SealRefused, SigningKey, Statement, sign};
use fleetcal_store::{DeploymentFreeze, IdempotencyKey, Store, StoreError};
use tokio::sync::{Mutex, Notify};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::Boxed;
use fleetcal_fleet::live::LiveUpdate;
use fleetcal_fleet::{FleetHandle, UsedValues};
use inbox::Inbox;
use policy::Rules;

/// Parts that the lifecycle uses.
#[derive(Debug)]
pub struct LifecycleSetup {
    /// Store of the records.
    pub store: Store,
    /// Fleet of the robots.
    pub fleet: FleetHandle,
    /// Clock of the service.
    pub clock: SharedClock,
    /// Policy of the configuration file.
    pub policy: Policy,
    /// Key that signs documents, and the changes that led to it.
    pub keys: ServiceKeys,
    /// Membership in a cluster, in which other instances decide as well.
    pub membership: Membership,
}

/// Records of one robot, and the lock of their changes.
#[derive(Debug)]
struct RobotLock {
    ledger: RwLock<Arc<RobotLedger>>,
    turn: Mutex<()>,
}

#[derive(Debug)]
struct Inner {
    store: Store,
    fleet: FleetHandle,
    clock: SharedClock,
    rules: Rules,
    key: Arc<SigningKey>,
    keys: ServiceKeys,
    membership: Membership,
    locks: RwLock<BTreeMap<RobotId, Arc<RobotLock>>>,
    freeze: RwLock<DeploymentFreeze>,
    answers: Inbox,
    losses: std::sync::Mutex<LossLog>,
    /// Signal that a message is to be sent.
    outbox: Notify,
    lost_answers: AtomicU64,
    unreadable_answers: AtomicU64,
    refused_answers: AtomicU64,
    stop: CancellationToken,
    tasks: TaskTracker,
}

/// Lifecycle of calibrations, cheap to clone.
#[derive(Debug, Clone)]
pub struct Lifecycle {
    inner: Arc<Inner>,
}

impl Lifecycle {
    /// Reads every robot's records and begins to work.
    ///
    /// # Errors
    /// The database's failure.
    pub fn start(setup: LifecycleSetup) -> Boxed<Result<Self, StoreError>> {
        Box::pin(Self::started(setup))
    }

    async fn started(setup: LifecycleSetup) -> Result<Self, StoreError> {
        let ledgers = setup.store.load_ledgers().await?;
        let freeze = setup.store.deployment_freeze().await?;
        let policy = setup.store.stored_policy().await?;
        let lifecycle = Self {
            inner: Arc::new(Inner {
                store: setup.store,
                fleet: setup.fleet,
                clock: setup.clock,
                rules: Rules::new(setup.policy, policy),
                key: Arc::new(setup.keys.key.clone()),
                keys: setup.keys,
                membership: setup.membership,
                locks: RwLock::default(),
                freeze: RwLock::new(freeze),
                answers: Inbox::default(),
                losses: std::sync::Mutex::default(),
                unreadable_answers: AtomicU64::new(0),
                outbox: Notify::new(),
                lost_answers: AtomicU64::new(0),
                refused_answers: AtomicU64::new(0),
                stop: CancellationToken::new(),
                tasks: TaskTracker::new(),
            }),
        };
        for ledger in ledgers {
            lifecycle.tell_fleet(&ledger);
            let lock = lifecycle.lock(&ledger.shadow.robot.clone());
            *lock.ledger.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(ledger);
        }
        let tasks = &lifecycle.inner.tasks;
        tasks.spawn(answers::hear(lifecycle.clone()));
        tasks.spawn(duty::attend(lifecycle.clone()));
        tasks.spawn(rollout_duty::attend(lifecycle.clone()));
        // What was decided before the service stopped may not have been sent.
        lifecycle.inner.outbox.notify_one();
        Ok(lifecycle)
    }

    /// Ends the lifecycle's own tasks. Decisions that are under way are finished.
    pub async fn stop(&self) {
        self.inner.stop.cancel();
        self.inner.tasks.close();
        self.inner.tasks.wait().await;
    }

    /// Public half of the key that signs documents.
    pub fn public_key(&self) -> PublicKey {
        self.inner.key.public_key()
    }

    /// Changes that led to this key, oldest first.
    pub fn key_changes(&self) -> &KeyChanges {
        &self.inner.keys.changes
    }

    /// Announcement of the changes of key; `None` if there was none.
    pub fn key_announcement(&self) -> Option<KeyAnnouncement> {
        self.key_changes().announcement()
    }

    /// Signs a statement with the key that signs documents.
    ///
    /// # Errors
    /// Those of [`sign`].
    pub fn sign<T: Statement>(&self, statement: &T) -> Result<Envelope, SealRefused> {
        sign(statement, &self.inner.key)
    }

    /// Records of a robot; empty ones for a robot without any.
    pub fn ledger(&self, robot: &RobotId) -> Arc<RobotLedger> {
        let locks = self
            .inner
            .locks
            .read()
            .unwrap_or_else(PoisonError::into_inner);
        let lock = locks.get(robot).map(Arc::clone);
        drop(locks);
        lock.map_or_else(
            || Arc::new(RobotLedger::new(robot.clone())),
            |lock| Arc::clone(&lock.ledger.read().unwrap_or_else(PoisonError::into_inner)),
        )
    }

    /// True if a signed document was ever made for any robot.
    pub fn has_given_out(&self) -> bool {
        let locks = self
            .inner
            .locks
            .read()
            .unwrap_or_else(PoisonError::into_inner);
        let signed = |lock: &Arc<RobotLock>| {
            let ledger = lock.ledger.read().unwrap_or_else(PoisonError::into_inner);
            !ledger.shadow.generation_last.is_factory()
        };
        locks.values().any(signed)
    }

    /// Present deployment freeze.
    pub fn deployment_freeze(&self) -> DeploymentFreeze {
        let freeze = self
            .inner
            .freeze
            .read()
            .unwrap_or_else(PoisonError::into_inner);
        freeze.clone()
    }

    /// Counts of robots' answers that were not stored, by reason.
    pub fn answer_counters(&self) -> [(&'static str, u64); 3] {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        [
            ("answer_limit", read(&self.inner.lost_answers)),
            ("answer_refused", read(&self.inner.refused_answers)),
            ("answer_unreadable", read(&self.inner.unreadable_answers)),
        ]
    }

    /// Applies a command to a robot's records; it is committed when this returns.
    ///
    /// # Errors
    /// [`StoreError::Refused`] if it does not fit them, or the database's failure; nothing has
    /// changed then.
    pub async fn decide(
        &self,
        robot: &RobotId,
        command: Command,
        actor: Actor,
        idempotency: Option<IdempotencyKey>,
    ) -> Result<Decided, StoreError> {
        let (lifecycle, robot) = (self.clone(), robot.clone());
        let made = (idempotency, None);
        self.see_through(async move { lifecycle.take(&robot, command, actor, made).await })
            .await
    }

    /// Applies a command that a roll-out releases.
    async fn decide_released(
        &self,
        robot: &RobotId,
        command: Command,
        actor: Actor,
        release: Release,
    ) -> Result<Decided, StoreError> {
        let (lifecycle, robot) = (self.clone(), robot.clone());
        let made = (None, Some(release));
        self.see_through(async move { lifecycle.take(&robot, command, actor, made).await })
            .await
    }

    /// Completes an operation even if its caller goes away meanwhile: committed changes must be
    /// stored here and sent.
    async fn see_through<T: Send + 'static>(
        &self,
        work: impl Future<Output = Result<T, StoreError>> + Send + 'static,
    ) -> Result<T, StoreError> {
        let ended = self.inner.tasks.spawn(work).await;
        ended.unwrap_or_else(|ended| match ended.try_into_panic() {
            Ok(panic) => std::panic::resume_unwind(panic),
            Err(_) => Err(StoreError::Closed),
        })
    }

    async fn take(
        &self,
        robot: &RobotId,
        command: Command,
        actor: Actor,
        (idempotency, release): (Option<IdempotencyKey>, Option<Release>),
    ) -> Result<Decided, StoreError> {
        let lock = self.lock(robot);
        let _turn = lock.turn.lock().await;
        let tenure = self.tenure_for(robot, &command, (&actor, release))?;
        let decision = Decide {
            robot: robot.clone(),
            command,
            actor,
            tenure,
            given_policy: self.given_policy(),
            key: Arc::clone(&self.inner.key),
            now: self.inner.clock.now(),
            idempotency,
            rear_axle_in_base_link: self.inner.fleet.rear_axle_in_base_link(robot),
            present: self.present(robot),
            view: self.inner.fleet.robot(robot).map(Box::new),
            cross_tracks: self.inner.fleet.cross_tracks(robot),
            release,
        };
        let decided = self.inner.store.transact(decision).await?;
        if let Decided::Taken(outcome) = &decided {
            let ledger = Arc::new(outcome.ledger.clone());
            self.tell_fleet(&ledger);
            *lock.ledger.write().unwrap_or_else(PoisonError::into_inner) = ledger;
            if !outcome.outbox.is_empty() {
                self.inner.outbox.notify_one();
            }
            let told = |transition| LiveUpdate::of_transition(robot, transition);
            let mut updates: Vec<_> = outcome.transitions.iter().map(told).collect();
            updates.dedup();
            for update in updates {
                self.inner.fleet.announce(update);
            }
        }
        Ok(decided)
    }

    /// Present estimate of a robot.
    pub fn present(&self, robot: &RobotId) -> Present {
        let Some(view) = self.inner.fleet.robot(robot) else {
            return Present::Unknown;
        };
        if view.reassembly_open {
            return Present::Reassembled;
        }
        if view.is_warned(WarningKind::TwoSenders) {
            return Present::TwoSenders;
        }
        match view.state {
            RobotState::Changed => Present::VehicleChanged,
            RobotState::Calibrated => {
                let known = view.estimate.as_deref().and_then(values_and_sigmas);
                known.map_or(Present::Unknown, |(values, sigmas)| Present::Known {
                    values,
                    sigmas,
                })
            }
            _ => Present::Unknown,
        }
    }

    /// Begins or ends the deployment freeze.
    ///
    /// # Errors
    /// [`StoreError::Refused`] if it changed since it was read, or the database's failure.
    pub async fn freeze(
        &self,
        frozen: bool,
        version: Version,
        actor: Actor,
        reason: String,
    ) -> Result<DeploymentFreeze, StoreError> {
        let write = SetFreeze {
            frozen,
            version,
            actor,
            now: self.inner.clock.now(),
            reason,
        };
        let lifecycle = self.clone();
        self.see_through(async move { lifecycle.take_freeze(write).await })
            .await
    }

    async fn take_freeze(&self, write: SetFreeze) -> Result<DeploymentFreeze, StoreError> {
        let freeze = self.inner.store.transact(write).await?;
        let mut known = self
            .inner
            .freeze
            .write()
            .unwrap_or_else(PoisonError::into_inner);
        if known.version < freeze.version {
            *known = freeze.clone();
        }
        drop(known);
        self.inner.outbox.notify_one();
        self.inner.fleet.announce(LiveUpdate::Freeze);
        Ok(freeze)
    }

    fn lock(&self, robot: &RobotId) -> Arc<RobotLock> {
        let locks = self
            .inner
            .locks
            .read()
            .unwrap_or_else(PoisonError::into_inner);
        if let Some(lock) = locks.get(robot) {
            return Arc::clone(lock);
        }
        drop(locks);
        let mut locks = self
            .inner
            .locks
            .write()
            .unwrap_or_else(PoisonError::into_inner);
        let new = || {
            Arc::new(RobotLock {
                ledger: RwLock::new(Arc::new(RobotLedger::new(robot.clone()))),
                turn: Mutex::default(),
            })
        };
        Arc::clone(locks.entry(robot.clone()).or_insert_with(new))
    }

    /// Passes the calibration in use, and the values to verify, to the robot's task.
    fn tell_fleet(&self, ledger: &RobotLedger) {
        let shadow = &ledger.shadow;
        let used = [&shadow.before, &shadow.in_use];
        // The agent's clock may have gone back between the two: their order is that of the answers.
        let used: Vec<_> = used
            .into_iter()
            .flatten()
            .map(|in_use| UsedValues {
                since: in_use.since_ns,
                generation: in_use.generation,
                values: in_use.values,
            })
            .collect();
        let in_verification = ledger.live.as_ref().and_then(|live| {
            let state = matches!(
                live.state,
                DeploymentState::Applied | DeploymentState::Verifying
            );
            let in_use = shadow.in_use.as_ref()?;
            (state && in_use.generation == live.offer.generation)
                .then_some((in_use.generation, in_use.since_ns))
        });
        let fleet = &self.inner.fleet;
        fleet.use_values(&shadow.robot, &used, in_verification);
        fleet.set_retired(&shadow.robot, shadow.retired.is_some());
    }
}
