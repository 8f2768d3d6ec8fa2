//! The rows by which instances of a cluster agree who estimates which robot.

use std::collections::BTreeMap;
use std::sync::{PoisonError, RwLock};
use std::time::Duration;

use async_trait::async_trait;
use fleetcal_cluster::{ClaimId, Duty, Hearing, InstanceId, Seat, Snapshot, Tenure};
use fleetcal_model::WallTime;
use fleetcal_proto::RobotId;

use crate::error::StoreError;

/// What an instance says of itself when it joins.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Joining {
    /// Its name, which one process uses at a time.
    pub instance: InstanceId,
    /// Where others reach its HTTP API.
    pub url: String,
    /// Its weight against others.
    pub capacity: u32,
    /// Version of its program.
    pub program: String,
    /// The newest format of a checkpoint that it can read.
    pub checkpoint_format: i64,
    /// Hash of the part of its configuration in which instances have to agree.
    pub config_sha256: Vec<u8>,
    /// The public half of what it signs documents with, in which all instances have to agree.
    pub signing_key: String,
}

/// What an instance says of itself with each renewal.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Renewal {
    /// Whether it reaches a Zenoh router, and its clock is right enough.
    pub linked: bool,
    /// Whether it is about to end.
    pub draining: bool,
    /// How far its wall clock was ahead of the database's at the renewal before, ns.
    pub clock_ahead_ns: i64,
    /// Instances and robots that it hears on Zenoh.
    pub hearing: Hearing,
}

/// How far the rows have come that a look has read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct RowsVersion(pub i64);

/// What a look at the rows has found.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// How far they have come.
    pub version: RowsVersion,
    /// What they say. Without robots and duties when these are still those of the version that the
    /// caller knows.
    pub snapshot: Snapshot,
    /// Whether `snapshot` has robots and duties.
    pub is_whole: bool,
}

/// Whom an instance takes for dead.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TakeForDead<'a> {
    /// Those whose lease has ended by the database's clock.
    LeaseEnded,
    /// Of these, whose liveliness token is gone or whose heartbeats are missing, those whose
    /// connection to the database is gone as well.
    Gone(&'a [InstanceId]),
}

/// One of several things that a try to sign in counts as.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Try {
    /// Those of one key count together.
    pub key: String,
    /// After so long one more is let through.
    pub every: Duration,
    /// So many are let through at once.
    pub burst: u32,
}

/// Where the rows are. Each method is one transaction; what it changes, it changes only for a seat
/// that is still that of its instance.
///
/// # Errors
/// Every method gives [`StoreError::Database`] when the database fails.
#[async_trait]
pub trait ClusterRegistry: std::fmt::Debug + Send + Sync + 'static {
    /// Begins a life of an instance, whose former lives end with it.
    ///
    /// # Errors
    /// [`StoreError::Server`] when another process uses the name, or when the cluster signs with
    /// another key.
    async fn join(&self, joining: &Joining) -> Result<Seat, StoreError>;

    /// Renews a lease; gives the database's time, or `None` when the seat was taken for dead.
    async fn renew(&self, seat: &Seat, renewal: Renewal) -> Result<Option<WallTime>, StoreError>;

    /// Reads instances, robots and duties; robots and duties only when they have changed since
    /// `known`.
    async fn look(&self, known: Option<RowsVersion>) -> Result<Look, StoreError>;

    /// Ends seats of others and frees what they had; gives those that were ended.
    async fn take_for_dead(
        &self,
        by: &Seat,
        which: TakeForDead<'_>,
    ) -> Result<Vec<Seat>, StoreError>;

    /// Claims robots that nobody has; gives the tenures of those that it got.
    async fn claim(
        &self,
        seat: &Seat,
        robots: &[(RobotId, ClaimId)],
    ) -> Result<Vec<Tenure>, StoreError>;

    /// Names who is to have these own robots next; `None` names nobody.
    async fn name_heirs(
        &self,
        seat: &Seat,
        robots: &[(RobotId, Option<Seat>)],
    ) -> Result<(), StoreError>;

    /// Says that the seat, their heir, hears these robots.
    async fn note_ready(&self, seat: &Seat, robots: &[RobotId]) -> Result<(), StoreError>;

    /// Hands own robots over to their heirs, who are still theirs; gives those that went.
    async fn hand_over(
        &self,
        seat: &Seat,
        robots: &[(RobotId, Seat, ClaimId)],
    ) -> Result<Vec<RobotId>, StoreError>;

    /// Gives up own robots.
    async fn free(&self, seat: &Seat, robots: &[RobotId]) -> Result<(), StoreError>;

    /// Claims duties that nobody has; gives those that it got.
    async fn claim_duties(&self, seat: &Seat, duties: &[Duty]) -> Result<Vec<Duty>, StoreError>;

    /// Gives up own duties.
    async fn free_duties(&self, seat: &Seat, duties: &[Duty]) -> Result<(), StoreError>;

    /// Counts a try to sign in over all instances, as each of `tries` in this order until one of them
    /// was too many; gives how long to wait then.
    async fn count_tries(&self, tries: &[Try]) -> Result<Option<Duration>, StoreError>;

    /// Forgets tries under these keys, since the last one was right, and remembers the pair of address
    /// and name that it came with.
    async fn signed_in(&self, pair: &str, tries: &[String]) -> Result<(), StoreError>;

    /// Whether somebody has signed in at any instance with this pair of address and name, among the
    /// latest [`SIGN_IN_KNOWN_MAX`](fleetcal_domain::limits::SIGN_IN_KNOWN_MAX) pairs.
    async fn has_signed_in(&self, pair: &str) -> Result<bool, StoreError>;

    /// Ends the seat and frees what it has.
    async fn leave(&self, seat: &Seat) -> Result<(), StoreError>;
}

/// The robots that this process estimates, with what tells its tenures from others'. What it writes
/// of a robot bears the tenure in which it was handed to the store.
#[derive(Debug, Default)]
pub struct Claims {
    of_robots: RwLock<Option<BTreeMap<RobotId, ClaimId>>>,
}

/// Under which tenure something is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Claimed {
    /// There is one instance, which has all robots.
    Alone,
    /// This one.
    Under(ClaimId),
    /// None: the robot is another instance's.
    Not,
}

impl Claims {
    /// From now on there are several instances, and this one has no robot yet.
    pub fn begin_cluster(&self) {
        self.write().get_or_insert_default();
    }

    /// Takes a tenure that began, or another one of the same robot.
    pub fn set(&self, tenure: &Tenure) {
        let mut claims = self.write();
        let claims = claims.get_or_insert_default();
        claims.insert(tenure.robot.clone(), tenure.claim);
    }

    /// Takes that a tenure has ended: what is handed over of the robot from now on is not written.
    pub fn remove(&self, robot: &RobotId) {
        if let Some(claims) = self.write().as_mut() {
            claims.remove(robot);
        }
    }

    /// Under which tenure something of a robot is written that is handed over now.
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
