//! Gate of all that this process may put on Zenoh now.

use fleetcal_clock::SharedClock;
use fleetcal_cluster::{Duty, Membership};
use fleetcal_proto::RobotId;

/// Asked in the line before everything that leaves but heartbeats. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Gate {
    membership: Membership,
    clock: SharedClock,
}

impl Gate {
    /// The gate of a process in this place of the cluster.
    pub fn new(membership: Membership, clock: SharedClock) -> Self {
        Self { membership, clock }
    }

    /// This process's place in the cluster.
    pub fn membership(&self) -> &Membership {
        &self.membership
    }

    /// Whether this process has a robot, so that what is about it may leave here.
    pub fn has(&self, robot: &RobotId) -> bool {
        self.membership.has(robot)
    }

    /// Whether anything may leave at this moment.
    pub fn may_act(&self) -> bool {
        self.membership.may_act(self.clock.uptime())
    }

    /// Whether something about a robot may leave at this moment.
    pub fn lets(&self, robot: &RobotId) -> bool {
        self.has(robot) && self.may_act()
    }

    /// Whether this process does something for the whole cluster.
    pub fn does(&self, duty: Duty) -> bool {
        self.membership.does(duty)
    }
}
