//! Gate of all that this process may put on Zenoh now.

use fleetcal_clock::SharedClock;
use fleetcal_cluster::{Duty, Membership};
use fleetcal_proto::RobotId;

/// Gate that is checked in the line before everything that is sent except heartbeats. Cheap to
/// clone.
#[derive(Debug, Clone)]
pub struct Gate {
    membership: Membership,
    clock: SharedClock,
}

impl Gate {
    /// Makes the gate of a process with this place in the cluster.
    pub fn new(membership: Membership, clock: SharedClock) -> Self {
        Self { membership, clock }
    }

    /// Returns this process's place in the cluster.
    pub fn membership(&self) -> &Membership {
        &self.membership
    }

    /// True if this process estimates a robot, so that messages about it may be sent here.
    pub fn has(&self, robot: &RobotId) -> bool {
        self.membership.has(robot)
    }

    /// True if anything may be sent at this moment.
    pub fn may_act(&self) -> bool {
        self.membership.may_act(self.clock.uptime())
    }

    /// True if messages about a robot may be sent at this moment.
    pub fn lets(&self, robot: &RobotId) -> bool {
        self.has(robot) && self.may_act()
    }

    /// True if this process has a duty for the whole cluster.
    pub fn does(&self, duty: Duty) -> bool {
        self.membership.does(duty)
    }
}
