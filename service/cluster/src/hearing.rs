//! Instances and robots received on Zenoh. If the routers lose their connection to each other, the
//! instances at both sides still agree by the database, but neither side receives the other's
//! robots.

use std::collections::BTreeSet;

use fleetcal_proto::RobotId;

use crate::InstanceId;

/// Instances and robots that an instance receives, from its row. Empty while it receives every
/// other instance, and they receive it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Hearing {
    /// Other instances that it does not receive.
    pub unheard_instances: BTreeSet<InstanceId>,
    /// Subscribed robots that it receives.
    pub heard_robots: BTreeSet<RobotId>,
    /// Subscribed robots that it does not receive.
    pub unheard_robots: BTreeSet<RobotId>,
}
