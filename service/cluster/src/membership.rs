//! Membership of a process in the cluster, shared by all of its parts.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};
use std::time::Duration;

use fleetcal_model::WallTime;
use fleetcal_proto::RobotId;

use crate::InstanceId;
use crate::duty::Duty;
use crate::lease::Lease;
use crate::member::Member;
use crate::plan::Snapshot;
use crate::tenure::{Seat, Tenure};

/// Whether this process is alone, or one instance of several. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct Membership {
    cluster: Option<Arc<Cluster>>,
}

/// This process as an instance of a cluster.
#[derive(Debug)]
pub struct Cluster {
    instance: InstanceId,
    lease: Lease,
    known: RwLock<Known>,
}

/// What the rows said last, and what this instance has by them.
#[derive(Debug, Default)]
struct Known {
    seat: Option<Seat>,
    snapshot: Arc<Snapshot>,
    tenures: BTreeMap<RobotId, Tenure>,
    duties: BTreeSet<Duty>,
    /// When the database answered last, running time.
    answered_at: Option<Duration>,
    last_takeover: Option<Takeover>,
    takeovers: u64,
}

/// That this instance has taken over what another one had.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Takeover {
    /// From whom.
    pub from: InstanceId,
    /// When, wall time.
    pub at: WallTime,
    /// How many robots became free by it.
    pub robots: usize,
}

/// Where a robot is estimated.
#[derive(Debug, Clone, PartialEq)]
pub enum Whereabouts {
    /// By this process.
    Here,
    /// By this instance.
    At(Box<Member>),
    /// By nobody at this moment.
    Nowhere,
}

impl Membership {
    /// A process that has all robots.
    pub fn alone() -> Self {
        Self::default()
    }

    /// An instance of a cluster, which has nothing yet.
    pub fn of(instance: InstanceId) -> Self {
        let cluster = Cluster {
            instance,
            lease: Lease::default(),
            known: RwLock::default(),
        };
        Self {
            cluster: Some(Arc::new(cluster)),
        }
    }

    /// The cluster; `None` of a process that is alone.
    pub fn cluster(&self) -> Option<&Arc<Cluster>> {
        self.cluster.as_ref()
    }

    /// Whether this process estimates a robot.
    pub fn has(&self, robot: &RobotId) -> bool {
        let cluster = self.cluster.as_ref();
        cluster.is_none_or(|cluster| cluster.known().tenures.contains_key(robot))
    }

    /// Whether this process has a duty.
    pub fn does(&self, duty: Duty) -> bool {
        let cluster = self.cluster.as_ref();
        cluster.is_none_or(|cluster| cluster.known().duties.contains(&duty))
    }

    /// Whether this process may put something on Zenoh, or tell somebody outside, at `now`,
    /// running time. To be asked in the line before.
    pub fn may_act(&self, now: Duration) -> bool {
        let cluster = self.cluster.as_ref();
        cluster.is_none_or(|cluster| cluster.lease.holds(now))
    }

    /// The tenure in which this process estimates a robot; `None` where it does not, or is alone.
    pub fn tenure(&self, robot: &RobotId) -> Option<Tenure> {
        self.cluster.as_ref()?.known().tenures.get(robot).cloned()
    }

    /// Where a robot is estimated.
    pub fn whereabouts(&self, robot: &RobotId) -> Whereabouts {
        let Some(cluster) = &self.cluster else {
            return Whereabouts::Here;
        };
        let known = cluster.known();
        if known.tenures.contains_key(robot) {
            return Whereabouts::Here;
        }
        let row = known.snapshot.robots.get(robot);
        let owner = row.and_then(|row| known.snapshot.member(row.owner.as_ref()?));
        match owner {
            Some(member) if Some(&member.seat) != known.seat.as_ref() => {
                Whereabouts::At(Box::new(member.clone()))
            }
            _ => Whereabouts::Nowhere,
        }
    }
}

impl Cluster {
    /// The name of this instance.
    pub fn instance(&self) -> &InstanceId {
        &self.instance
    }

    /// This instance's lease.
    pub fn lease(&self) -> &Lease {
        &self.lease
    }

    /// Its life now; `None` while it has not joined.
    pub fn seat(&self) -> Option<Seat> {
        self.known().seat.clone()
    }

    /// What the rows said last.
    pub fn snapshot(&self) -> Arc<Snapshot> {
        Arc::clone(&self.known().snapshot)
    }

    /// The robots that this instance has.
    pub fn tenures(&self) -> BTreeMap<RobotId, Tenure> {
        self.known().tenures.clone()
    }

    /// The duties that this instance has.
    pub fn duties(&self) -> BTreeSet<Duty> {
        self.known().duties.clone()
    }

    /// When the database answered last, running time; `None` before the first time.
    pub fn answered_at(&self) -> Option<Duration> {
        self.known().answered_at
    }

    /// What it took over last.
    pub fn last_takeover(&self) -> Option<Takeover> {
        self.known().last_takeover.clone()
    }

    /// Takes that it has begun a life.
    pub fn joined(&self, seat: Seat) {
        self.write().seat = Some(seat);
    }

    /// Takes that its life has ended: it has nothing any more. Gives what it had.
    pub fn lost(&self) -> BTreeMap<RobotId, Tenure> {
        self.lease.lost();
        let mut known = self.write();
        known.seat = None;
        known.duties.clear();
        std::mem::take(&mut known.tenures)
    }

    /// Takes what the rows say.
    pub fn read(&self, snapshot: Arc<Snapshot>) {
        self.write().snapshot = snapshot;
    }

    /// Takes that the database answered what was asked at `asked_at`, running time.
    pub fn answered(&self, asked_at: Duration) {
        self.write().answered_at = Some(asked_at);
    }

    /// Takes a tenure that began.
    pub fn began(&self, tenure: Tenure) {
        self.write().tenures.insert(tenure.robot.clone(), tenure);
    }

    /// Takes that a tenure has ended.
    pub fn ended(&self, robot: &RobotId) {
        self.write().tenures.remove(robot);
    }

    /// Takes which duties it has.
    pub fn set_duties(&self, duties: BTreeSet<Duty>) {
        self.write().duties = duties;
    }

    /// Takes that it has taken over what another one had.
    pub fn took_over(&self, takeover: Takeover) {
        let mut known = self.write();
        known.last_takeover = Some(takeover);
        known.takeovers += 1;
    }

    /// How often it has taken over what another one had, since it was started.
    pub fn takeovers(&self) -> u64 {
        self.known().takeovers
    }

    // What is known is whole after every statement, so the panic of another thread is no reason to
    // stop.
    fn known(&self) -> RwLockReadGuard<'_, Known> {
        self.known.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self) -> RwLockWriteGuard<'_, Known> {
        self.known.write().unwrap_or_else(PoisonError::into_inner)
    }
}
