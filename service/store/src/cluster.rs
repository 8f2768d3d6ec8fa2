//! Rows by which the instances of a cluster agree on which of them estimates which robot.

use std::collections::BTreeMap;
use std::sync::{PoisonError, RwLock};
use std::time::Duration;

use async_trait::async_trait;
use fleetcal_cluster::{ClaimId, Duty, Hearing, InstanceId, Seat, Snapshot, Tenure};
use fleetcal_model::WallTime;
use fleetcal_proto::RobotId;

use crate::error::StoreError;

/// Properties of an instance that joins.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Joining {
    /// Name, which one process uses at a time.
    pub instance: InstanceId,
    /// Address of its HTTP API for other instances.
    pub url: String,
    /// Weight in the distribution of robots.
    pub capacity: u32,
    /// Version of its program.
    pub program: String,
    /// Newest format of a checkpoint that it can read.
    pub checkpoint_format: i64,
    /// Hash of the part of its configuration that all instances must share.
    pub config_sha256: Vec<u8>,
    /// Public half of the key that it signs documents with, which all instances must share.
    pub signing_key: String,
    /// Public halves of the keys that it replaced, by changes that each of them has signed.
    pub former_signing_keys: Vec<String>,
}

/// State of an instance at a renewal of its lease.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Renewal {
    /// True if it is connected to a Zenoh router, and its clock is accurate enough.
    pub linked: bool,
    /// True if it is about to end.
    pub draining: bool,
    /// Lead of its wall clock over the database's at the renewal before, ns.
    pub clock_ahead_ns: i64,
    /// Instances and robots that it receives from on Zenoh.
    pub hearing: Hearing,
}

/// Version of the rows that a look has read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct RowsVersion(pub i64);

/// Result of a look at the rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// Version of the rows.
    pub version: RowsVersion,
    /// Snapshot of the rows; without robots and duties if these have not changed since the version
    /// that the caller has.
    pub snapshot: Snapshot,
    /// True if `snapshot` has robots and duties.
    pub is_whole: bool,
}

/// Instances to declare dead.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TakeForDead<'a> {
    /// Instances whose lease has ended by the database's clock.
    LeaseEnded,
    /// Given instances, each without a liveliness token or with missing heartbeats, whose
    /// connection to the database is gone as well.
    Gone(&'a [InstanceId]),
}

/// Counter that an attempt to sign in is counted under.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Try {
    /// Key of the counter.
    pub key: String,
    /// Time after which one more attempt is admitted.
    pub every: Duration,
    /// Attempts that are admitted at once.
    pub burst: u32,
}

/// Registry of a cluster's instances, robots and duties. Each method is one transaction, and
/// changes rows only for a seat that is still its instance's.
///
/// # Errors
/// Every method returns [`StoreError::Database`] when the database fails.
#[async_trait]
pub trait ClusterRegistry: std::fmt::Debug + Send + Sync + 'static {
    /// Begins a life of an instance, which ends its former ones.
    ///
    /// # Errors
    /// [`StoreError::Server`] if another process uses the name, or the cluster signs with another
    /// key.
    async fn join(&self, joining: &Joining) -> Result<Seat, StoreError>;

    /// Renews a lease; returns the database's time, or `None` if the seat was declared dead.
    async fn renew(&self, seat: &Seat, renewal: Renewal) -> Result<Option<WallTime>, StoreError>;

    /// Reads instances, robots and duties; robots and duties only if they have changed since
    /// `known`.
    async fn look(&self, known: Option<RowsVersion>) -> Result<Look, StoreError>;

    /// Ends seats of other instances and frees their robots and duties; returns the ended seats.
    async fn take_for_dead(
        &self,
        by: &Seat,
        which: TakeForDead<'_>,
    ) -> Result<Vec<Seat>, StoreError>;

    /// Claims robots without an owner; returns the tenures that it got.
    async fn claim(
        &self,
        seat: &Seat,
        robots: &[(RobotId, ClaimId)],
    ) -> Result<Vec<Tenure>, StoreError>;

    /// Names the next owner of these own robots; `None` names nobody.
    async fn name_heirs(
        &self,
        seat: &Seat,
        robots: &[(RobotId, Option<Seat>)],
    ) -> Result<(), StoreError>;

    /// Records that the seat, their heir, receives these robots' messages.
    async fn note_ready(&self, seat: &Seat, robots: &[RobotId]) -> Result<(), StoreError>;

    /// Hands own robots over to their heirs, if these have not changed; returns the robots that
    /// went.
    async fn hand_over(
        &self,
        seat: &Seat,
        robots: &[(RobotId, Seat, ClaimId)],
    ) -> Result<Vec<RobotId>, StoreError>;

    /// Releases own robots.
    async fn free(&self, seat: &Seat, robots: &[RobotId]) -> Result<(), StoreError>;

    /// Claims duties without an owner; returns the duties that it got.
    async fn claim_duties(&self, seat: &Seat, duties: &[Duty]) -> Result<Vec<Duty>, StoreError>;

    /// Releases own duties.
    async fn free_duties(&self, seat: &Seat, duties: &[Duty]) -> Result<(), StoreError>;

    /// Counts an attempt to sign in over all instances, under each of `tries` in this order until
    /// one is exhausted; returns the wait in that case.
    async fn count_tries(&self, tries: &[Try]) -> Result<Option<Duration>, StoreError>;

    /// Resets the counters of these keys after a successful sign-in, and remembers its pair of
    /// address and name.
    async fn signed_in(&self, pair: &str, tries: &[String]) -> Result<(), StoreError>;

    /// True if a sign-in at any instance had this pair of address and name, among the latest
    /// [`SIGN_IN_KNOWN_MAX`](fleetcal_domain::limits::SIGN_IN_KNOWN_MAX) pairs.
    async fn has_signed_in(&self, pair: &str) -> Result<bool, StoreError>;

    /// Ends the seat and frees its robots and duties.
    async fn leave(&self, seat: &Seat) -> Result<(), StoreError>;
}

/// Tenures of the robots that this process estimates. A row of a robot carries the tenure in which
/// it was queued.
#[derive(Debug, Default)]
pub struct Claims {
    of_robots: RwLock<Option<BTreeMap<RobotId, ClaimId>>>,
}

/// Tenure that a row is written under.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Claimed {
    /// No tenure, as a single service has all robots.
    Alone,
    /// Tenure of this claim.
    Under(ClaimId),
    /// No tenure, as the robot is another instance's.
    Not,
}

impl Claims {
    /// Begins work as one of several instances, without a robot yet.
    pub fn begin_cluster(&self) {
        self.write().get_or_insert_default();
    }

    /// Sets the tenure of a robot.
    pub fn set(&self, tenure: &Tenure) {
        let mut claims = self.write();
        let claims = claims.get_or_insert_default();
        claims.insert(tenure.robot.clone(), tenure.claim);
    }

    /// Removes an ended tenure: rows of the robot queued from now on are not written.
    pub fn remove(&self, robot: &RobotId) {
        if let Some(claims) = self.write().as_mut() {
            claims.remove(robot);
        }
    }

    /// Tenure of a robot's rows that are queued now.
    pub fn of(&self, robot: &RobotId) -> Claimed {
        let claims = self.of_robots.read();
        match &*claims.unwrap_or_else(PoisonError::into_inner) {
            None => Claimed::Alone,
            Some(claims) => claims
                .get(robot)
                .map_or(Claimed::Not, |claim| Claimed::Under(*claim)),
        }
    }

    // The map is whole after every statement, so the panic of another thread is no reason to stop.
    fn write(&self) -> std::sync::RwLockWriteGuard<'_, Option<BTreeMap<RobotId, ClaimId>>> {
        self.of_robots
            .write()
            .unwrap_or_else(PoisonError::into_inner)
    }
}
