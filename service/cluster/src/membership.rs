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

/// Membership of a process that is alone, or one instance of several. Cheap to clone.
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

/// Latest rows that were read, and the robots and duties of this instance by them.
#[derive(Debug, Default)]
struct Known {
    seat: Option<Seat>,
    snapshot: Arc<Snapshot>,
    tenures: BTreeMap<RobotId, Tenure>,
    duties: BTreeSet<Duty>,
    /// Time of the database's last answer, running time.
    answered_at: Option<Duration>,
    last_takeover: Option<Takeover>,
    takeovers: u64,
}

/// Takeover from another instance.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Takeover {
    /// Former owner.
    pub from: InstanceId,
    /// Time of the takeover, wall time.
    pub at: WallTime,
    /// Number of robots that became free.
    pub robots: usize,
}

/// Place at which a robot is estimated.
#[derive(Debug, Clone, PartialEq)]
pub enum Whereabouts {
    /// This process.
    Here,
    /// Another instance.
    At(Box<Member>),
    /// None at this moment.
    Nowhere,
}

impl Membership {
    /// Makes the membership of a process that has all robots.
    pub fn alone() -> Self {
        Self::default()
    }

    /// Makes the membership of an instance that has no robot yet.
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

    /// Cluster of the process; `None` if it is alone.
    pub fn cluster(&self) -> Option<&Arc<Cluster>> {
        self.cluster.as_ref()
    }

    /// True if this process estimates a robot.
    pub fn has(&self, robot: &RobotId) -> bool {
        let cluster = self.cluster.as_ref();
        cluster.is_none_or(|cluster| cluster.known().tenures.contains_key(robot))
    }

    /// True if this process has a duty.
    pub fn does(&self, duty: Duty) -> bool {
        let cluster = self.cluster.as_ref();
        cluster.is_none_or(|cluster| cluster.known().duties.contains(&duty))
    }

    /// True if this process may publish on Zenoh, or send to other programs, at `now`, running
    /// time. Each such action checks it in the line before.
    pub fn may_act(&self, now: Duration) -> bool {
        let cluster = self.cluster.as_ref();
        cluster.is_none_or(|cluster| cluster.lease.holds(now))
    }

    /// Tenure of a robot that this process estimates; `None` for other robots, and for a process
    /// that is alone.
    pub fn tenure(&self, robot: &RobotId) -> Option<Tenure> {
        self.cluster.as_ref()?.known().tenures.get(robot).cloned()
    }

    /// Place at which a robot is estimated.
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
    /// Name of this instance.
    pub fn instance(&self) -> &InstanceId {
        &self.instance
    }

    /// Lease of this instance.
    pub fn lease(&self) -> &Lease {
        &self.lease
    }

    /// Present life of this instance; `None` while it has not joined.
    pub fn seat(&self) -> Option<Seat> {
        self.known().seat.clone()
    }

    /// Latest rows that were read.
    pub fn snapshot(&self) -> Arc<Snapshot> {
        Arc::clone(&self.known().snapshot)
    }

    /// Tenures of this instance's robots.
    pub fn tenures(&self) -> BTreeMap<RobotId, Tenure> {
        self.known().tenures.clone()
    }

    /// Duties of this instance.
    pub fn duties(&self) -> BTreeSet<Duty> {
        self.known().duties.clone()
    }

    /// Time of the database's last answer, running time; `None` before the first one.
    pub fn answered_at(&self) -> Option<Duration> {
        self.known().answered_at
    }

    /// Last takeover by this instance.
    pub fn last_takeover(&self) -> Option<Takeover> {
        self.known().last_takeover.clone()
    }

    /// Records the begin of a life.
    pub fn joined(&self, seat: Seat) {
        self.write().seat = Some(seat);
    }

    /// Records the end of its life, and with it of its tenures and duties. Returns the former
    /// tenures.
    pub fn lost(&self) -> BTreeMap<RobotId, Tenure> {
        self.lease.lost();
        let mut known = self.write();
        known.seat = None;
        known.duties.clear();
        std::mem::take(&mut known.tenures)
    }

    /// Stores the rows that were read.
    pub fn read(&self, snapshot: Arc<Snapshot>) {
        self.write().snapshot = snapshot;
    }

    /// Records that the database answered a request of `asked_at`, running time.
    pub fn answered(&self, asked_at: Duration) {
        self.write().answered_at = Some(asked_at);
    }

    /// Adds a tenure that began.
    pub fn began(&self, tenure: Tenure) {
        self.write().tenures.insert(tenure.robot.clone(), tenure);
    }

    /// Removes a tenure that has ended.
    pub fn ended(&self, robot: &RobotId) {
        self.write().tenures.remove(robot);
    }

    /// Sets its duties.
    pub fn set_duties(&self, duties: BTreeSet<Duty>) {
        self.write().duties = duties;
    }

    /// Records a takeover from another instance.
    pub fn took_over(&self, takeover: Takeover) {
        let mut known = self.write();
        known.last_takeover = Some(takeover);
        known.takeovers += 1;
    }

    /// Number of takeovers by this instance since it was started.
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
