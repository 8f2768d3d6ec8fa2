//! Keeps this process's place in the cluster: renews its lease, looks at the rows, and takes on,
//! hands over and gives up robots as [`fleetcal_cluster::plan`] says.
//!
//! Two tasks: one renews, so that nothing that takes long ever keeps the lease waiting, and one
//! looks and acts.

mod acting;
mod listening;
mod renewing;

use std::sync::Arc;
use std::sync::atomic::AtomicI64;
use std::time::Duration;

use fleetcal_clock::SharedClock;
use fleetcal_cluster::{Cluster, Hearing, LinkReport, Membership};
use fleetcal_domain::limits;
use fleetcal_fleet::FleetHandle;
use fleetcal_store::cluster::{ClusterRegistry, Joining};
use fleetcal_store::{Store, StoreError};
use tokio::sync::{Notify, watch};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::Boxed;
use crate::entropy::NoEntropy;
use crate::lifecycle::Lifecycle;

/// What ownership is kept with.
#[derive(Debug)]
pub struct OwnershipSetup {
    /// Where robots' states are.
    pub store: Store,
    /// The robots.
    pub fleet: FleetHandle,
    /// Their records.
    pub lifecycle: Lifecycle,
    /// What every part of the process asks.
    pub membership: Membership,
    /// Where time comes from.
    pub clock: SharedClock,
    /// What this instance says of itself; `None` of a process that is alone.
    pub joining: Option<Joining>,
    /// What the link says.
    pub link: watch::Receiver<LinkReport>,
    /// Whether an instance is taken for dead before its lease ends, when its connection to the
    /// database is gone and nothing is heard of it on Zenoh.
    pub fast_takeover: bool,
    /// Where chance comes from: names of tenures.
    pub draw: fn() -> Result<i64, NoEntropy>,
}

#[derive(Debug)]
struct Inner {
    setup: OwnershipSetup,
    /// The rows.
    registry: Arc<dyn ClusterRegistry>,
    joining: Joining,
    cluster: Arc<Cluster>,
    /// Since when renewals have worked, running time.
    connected_since: std::sync::Mutex<Option<Duration>>,
    /// By how much its wall clock was ahead of the database's last, ns.
    clock_ahead_ns: AtomicI64,
    draining: watch::Sender<bool>,
    /// Instances and robots that it hears, for its row.
    hearing: watch::Sender<Hearing>,
    /// A renewal was refused: look at once.
    seat_lost: Notify,
    stop: CancellationToken,
    tasks: TaskTracker,
}

/// This process's place in the cluster, cheap to clone.
#[derive(Debug, Clone)]
pub struct Ownership {
    inner: Arc<Inner>,
}

impl Ownership {
    /// Joins the cluster and goes to work.
    ///
    /// # Errors
    /// [`StoreError::Server`] when another process uses the name or the cluster signs with another
    /// key; otherwise the database's failure.
    pub fn start(setup: OwnershipSetup) -> Boxed<Result<Option<Self>, StoreError>> {
        Box::pin(async move {
            let cluster = setup.membership.cluster().map(Arc::clone);
            let rows = setup.store.registry();
            let (Some(cluster), Some(registry), Some(joining)) =
                (cluster, rows, setup.joining.clone())
            else {
                return Ok(None);
            };
            let ownership = Self {
                inner: Arc::new(Inner {
                    setup,
                    registry,
                    joining,
                    cluster,
                    connected_since: std::sync::Mutex::default(),
                    clock_ahead_ns: AtomicI64::new(0),
                    draining: watch::Sender::new(false),
                    hearing: watch::Sender::default(),
                    seat_lost: Notify::new(),
                    stop: CancellationToken::new(),
                    tasks: TaskTracker::new(),
                }),
            };
            ownership.join().await?;
            let tasks = &ownership.inner.tasks;
            tasks.spawn(renewing::renew(ownership.clone()));
            tasks.spawn(acting::attend(ownership.clone()));
            Ok(Some(ownership))
        })
    }

    /// Gives its robots to the others, as far as they take them in time, and leaves.
    pub async fn leave(&self) {
        self.inner.draining.send_replace(true);
        let all_given = acting::until_nothing_is_left(self);
        if tokio::time::timeout(limits::CLUSTER_DRAIN_TIMEOUT, all_given)
            .await
            .is_err()
        {
            tracing::warn!("robots were not taken over in time: they are free now");
        }
        self.inner.stop.cancel();
        self.inner.tasks.close();
        self.inner.tasks.wait().await;
        if let Err(error) = self.give_up_everything().await {
            tracing::warn!(%error, "the instance did not leave the cluster: its lease has to end");
        }
    }

    /// Begins a life.
    async fn join(&self) -> Result<(), StoreError> {
        let setup = &self.inner.setup;
        let asked_at = setup.clock.uptime();
        let seat = self.inner.registry.join(&self.inner.joining).await?;
        tracing::info!(instance = %seat.instance.as_str(), incarnation = seat.incarnation.0, "joined the cluster");
        self.inner.cluster.joined(seat);
        self.inner.cluster.lease().renewed(asked_at);
        self.note_connected(Some(asked_at));
        Ok(())
    }

    /// Notes whether renewals work.
    fn note_connected(&self, at: Option<Duration>) {
        let since = self.inner.connected_since.lock();
        let mut since = since.unwrap_or_else(std::sync::PoisonError::into_inner);
        match at {
            Some(at) => {
                since.get_or_insert(at);
            }
            None => *since = None,
        }
    }

    /// Whether renewals have worked for so long that others' silence is theirs.
    fn may_judge_others(&self) -> bool {
        let since = self.inner.connected_since.lock();
        let since = *since.unwrap_or_else(std::sync::PoisonError::into_inner);
        let now = self.inner.setup.clock.uptime();
        since.is_some_and(|since| now.saturating_sub(since) >= limits::CLUSTER_CONNECTED_FOR)
    }
}
