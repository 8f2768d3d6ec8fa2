//! Hearing on Zenoh. Where the routers are cut from each other, the instances at either
//! side still agree by the database, but neither hears the robots at the other one.

use std::collections::BTreeSet;

use fleetcal_proto::RobotId;

use crate::InstanceId;

/// Instances and robots that an instance hears, as its row says. Empty while it hears every other instance, and is heard by
/// them.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Hearing {
    /// Other instances that it does not hear.
    pub unheard_instances: BTreeSet<InstanceId>,
    /// Of the robots to which it listens, those that it hears.
    pub heard_robots: BTreeSet<RobotId>,
    /// Of the robots to which it listens, those that it does not hear.
    pub unheard_robots: BTreeSet<RobotId>,
}
