//! Ownership of robots by this process in the cluster: it renews the lease, looks at the rows, and
//! claims, hands over and releases robots as [`fleetcal_cluster::plan`] states.
//!
//! Two tasks: one renews, so that no long operation delays the lease, and one looks and acts.

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

/// Parts that the ownership uses.
#[derive(Debug)]
pub struct OwnershipSetup {
    /// Store of the robots' states.
    pub store: Store,
    /// Robots of the fleet.
    pub fleet: FleetHandle,
    /// Records of the robots.
    pub lifecycle: Lifecycle,
    /// Membership that every part of the process reads.
    pub membership: Membership,
    /// Clock of the service.
    pub clock: SharedClock,
    /// Properties of this instance; `None` for a process that is alone.
    pub joining: Option<Joining>,
    /// Reports of the link.
    pub link: watch::Receiver<LinkReport>,
    /// True if an instance is declared dead before its lease ends, when its connection to the
    /// database is gone and it is not received on Zenoh.
    pub fast_takeover: bool,
    /// Random numbers for claims of tenures.
    pub draw: fn() -> Result<i64, NoEntropy>,
}

#[derive(Debug)]
struct Inner {
    setup: OwnershipSetup,
    /// Rows of the cluster.
    registry: Arc<dyn ClusterRegistry>,
    joining: Joining,
    cluster: Arc<Cluster>,
    /// Begin of the time in which renewals have succeeded, running time.
    connected_since: std::sync::Mutex<Option<Duration>>,
    /// Lead of its wall clock over the database's at the last renewal, ns.
    clock_ahead_ns: AtomicI64,
    draining: watch::Sender<bool>,
    /// Instances and robots that it receives, for its row.
    hearing: watch::Sender<Hearing>,
    /// Signal that a renewal was refused, and a look is due at once.
    seat_lost: Notify,
    stop: CancellationToken,
    tasks: TaskTracker,
}

/// Ownership of robots by this process in the cluster, cheap to clone.
#[derive(Debug, Clone)]
pub struct Ownership {
    inner: Arc<Inner>,
}

impl Ownership {
    /// Joins the cluster and begins to work.
    ///
    /// # Errors
    /// [`StoreError::Server`] if another process uses the name or the cluster signs with another
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

    /// Hands its robots over to the others, if these claim them in time, and leaves.
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

    /// Records whether renewals succeed.
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

    /// True if renewals have succeeded for so long that the others' silence is not this instance's
    /// own failure.
    fn may_judge_others(&self) -> bool {
        let since = self.inner.connected_since.lock();
        let since = *since.unwrap_or_else(std::sync::PoisonError::into_inner);
        let now = self.inner.setup.clock.uptime();
        since.is_some_and(|since| now.saturating_sub(since) >= limits::CLUSTER_CONNECTED_FOR)
    }
}
