//! The rows by which instances of a cluster agree who estimates which robot.
//!
//! Who ends a life or a tenure locks the instance's row FOR UPDATE first; who writes on the strength
//! of one holds it FOR KEY SHARE until the transaction ends. So nothing of an ended tenure is
//! committed behind its end. Rows are locked in this order, which excludes deadlocks: the caller's
//! instance, other instances by their names, robots by their keys, duties.

pub(crate) mod adoption;
mod duties;
mod fence;
mod life;
mod look;
mod robots;
mod seat;
mod transaction;
mod tries;

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use fleetcal_cluster::{ClaimId, Duty, InstanceId, Seat, Tenure};
use fleetcal_domain::limits;
use fleetcal_model::{RobotId, WallTime};
use fleetcal_store::StoreError;
use fleetcal_store::cluster::{
    ClusterRegistry, Joining, Look, Renewal, RowsVersion, TakeForDead, Try,
};
use tokio::sync::Mutex;
use tokio::time::Instant;

use crate::advisory::{AdvisoryLock, Locked};
use crate::failure::Fate;
use crate::line::Line;
use crate::servers::{Purpose, Servers};
use transaction::Transaction;

pub(crate) use fence::Fence;
pub use fence::Fencing;

/// Isolation in which each statement sees the commits before it.
const BEGIN: &str = "BEGIN ISOLATION LEVEL READ COMMITTED";
/// Isolation in which all statements see one moment.
const BEGIN_LOOK: &str = "BEGIN ISOLATION LEVEL REPEATABLE READ, READ ONLY";

/// Cluster's rows over three connections, so that renewals never wait: one for the lease, which
/// also holds the lock of the instance's name, one for attempts to sign in, one for the rest.
#[derive(Debug)]
pub(crate) struct Registry {
    servers: Arc<Servers>,
    lease: Mutex<Line>,
    ownership: Mutex<Line>,
    /// Connection for attempts to sign in, which anybody may make in numbers.
    tries: Mutex<Line>,
    /// Least number in an order that the database assigned at the last renewal of the lease: it
    /// moves with each promotion.
    floor: AtomicI64,
}

impl Registry {
    /// Makes the registry of an instance of this name; it connects on first use.
    pub(crate) fn new(servers: Arc<Servers>, instance: &InstanceId) -> Self {
        let lock = AdvisoryLock::new(Locked::Name(instance.clone()));
        let line = |purpose, lock| Mutex::new(Line::new(Arc::clone(&servers), purpose, None, lock));
        Self {
            lease: line(Purpose::Lease, Some(lock)),
            ownership: line(Purpose::Ownership, None),
            tries: line(Purpose::Tries, None),
            floor: AtomicI64::new(0),
            servers,
        }
    }

    /// Reads the instances alone, in one statement; returns `None` if robots or duties have
    /// changed, or the connection is lost.
    async fn glance(&self, known: RowsVersion) -> Result<Option<Look>, StoreError> {
        let mut line = self.ownership.lock().await;
        let Some(mut session) = line.take_usable() else {
            return Ok(None);
        };
        let asked_at = Instant::now();
        let looked = look::glance(&mut session).await;
        let is_lost = session.fate() == Fate::Lost;
        // The next look has time for a second server; this one was asked too long ago.
        let is_late = asked_at.elapsed() >= limits::CLUSTER_STATEMENT_TIMEOUT;
        match looked {
            Err(_) if is_lost && !is_late => Ok(None),
            Err(error) if is_lost => Err(error),
            looked => {
                line.session = Some(session);
                looked.map(|look| (look.version == known).then_some(look))
            }
        }
    }
}

#[async_trait]
impl ClusterRegistry for Registry {
    async fn join(&self, joining: &Joining) -> Result<Seat, StoreError> {
        let mut joined = Transaction::begin(&self.lease, BEGIN).await?;
        let seat = life::join(joined.session(), joining, &self.servers.name()).await;
        joined.end(seat).await
    }

    async fn renew(&self, seat: &Seat, renewal: Renewal) -> Result<Option<WallTime>, StoreError> {
        let mut renewed = Transaction::begin(&self.lease, BEGIN).await?;
        let granted = life::renew(renewed.session(), seat, renewal).await;
        let Some((now, floor)) = renewed.end(granted).await? else {
            return Ok(None);
        };
        if self.floor.load(Ordering::Relaxed) != floor {
            let mut raised = Transaction::begin(&self.ownership, BEGIN).await?;
            let done = life::raise_epochs(raised.session(), seat).await;
            raised.end(done).await?;
            self.floor.store(floor, Ordering::Relaxed);
        }
        Ok(Some(now))
    }

    async fn look(&self, known: Option<RowsVersion>) -> Result<Look, StoreError> {
        if let Some(known) = known
            && let Some(look) = self.glance(known).await?
        {
            return Ok(look);
        }
        let mut looked = Transaction::begin(&self.ownership, BEGIN_LOOK).await?;
        let look = look::look(looked.session()).await;
        looked.end(look).await
    }

    async fn take_for_dead(
        &self,
        by: &Seat,
        which: TakeForDead<'_>,
    ) -> Result<Vec<Seat>, StoreError> {
        let mut taken = Transaction::begin(&self.ownership, BEGIN).await?;
        let seats = life::take_for_dead(taken.session(), by, which).await;
        taken.end(seats).await
    }

    async fn claim(
        &self,
        seat: &Seat,
        robots: &[(RobotId, ClaimId)],
    ) -> Result<Vec<Tenure>, StoreError> {
        let mut claimed = Transaction::begin(&self.ownership, BEGIN).await?;
        let tenures = robots::claim(claimed.session(), seat, robots).await;
        claimed.end(tenures).await
    }

    async fn name_heirs(
        &self,
        seat: &Seat,
        robots: &[(RobotId, Option<Seat>)],
    ) -> Result<(), StoreError> {
        let mut named = Transaction::begin(&self.ownership, BEGIN).await?;
        let done = robots::name_heirs(named.session(), seat, robots).await;
        named.end(done).await
    }

    async fn note_ready(&self, seat: &Seat, robots: &[RobotId]) -> Result<(), StoreError> {
        let mut noted = Transaction::begin(&self.ownership, BEGIN).await?;
        let done = robots::note_ready(noted.session(), seat, robots).await;
        noted.end(done).await
    }

    async fn hand_over(
        &self,
        seat: &Seat,
        robots: &[(RobotId, Seat, ClaimId)],
    ) -> Result<Vec<RobotId>, StoreError> {
        let mut handed = Transaction::begin(&self.ownership, BEGIN).await?;
        let went = robots::hand_over(handed.session(), seat, robots).await;
        handed.end(went).await
    }

    async fn free(&self, seat: &Seat, robots: &[RobotId]) -> Result<(), StoreError> {
        let mut freed = Transaction::begin(&self.ownership, BEGIN).await?;
        let done = robots::free(freed.session(), seat, robots).await;
        freed.end(done).await
    }

    async fn claim_duties(&self, seat: &Seat, duties: &[Duty]) -> Result<Vec<Duty>, StoreError> {
        let mut claimed = Transaction::begin(&self.ownership, BEGIN).await?;
        let got = duties::claim(claimed.session(), seat, duties).await;
        claimed.end(got).await
    }

    async fn free_duties(&self, seat: &Seat, duties: &[Duty]) -> Result<(), StoreError> {
        let mut freed = Transaction::begin(&self.ownership, BEGIN).await?;
        let done = duties::free(freed.session(), seat, duties).await;
        freed.end(done).await
    }

    async fn count_tries(&self, tries: &[Try]) -> Result<Option<Duration>, StoreError> {
        let mut counted = Transaction::begin(&self.tries, BEGIN).await?;
        let wait = tries::count(counted.session(), tries).await;
        counted.end(wait).await
    }

    async fn signed_in(&self, pair: &str, tries: &[String]) -> Result<(), StoreError> {
        let mut noted = Transaction::begin(&self.tries, BEGIN).await?;
        let done = async {
            tries::forget(noted.session(), tries).await?;
            tries::note_pair(noted.session(), pair).await
        };
        let done = done.await;
        noted.end(done).await
    }

    async fn has_signed_in(&self, pair: &str) -> Result<bool, StoreError> {
        let mut asked = Transaction::begin(&self.tries, BEGIN).await?;
        let known = tries::knows_pair(asked.session(), pair).await;
        asked.end(known).await
    }

    async fn leave(&self, seat: &Seat) -> Result<(), StoreError> {
        let mut left = Transaction::begin(&self.ownership, BEGIN).await?;
        let done = life::leave(left.session(), seat).await;
        left.end(done).await
    }
}
