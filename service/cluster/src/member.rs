//! Members of a cluster.

use std::time::Duration;

use fleetcal_domain::limits::CLUSTER_CLOCK_USED_UP_TO;

use crate::hearing::Hearing;
use crate::tenure::Seat;

/// Member of a cluster, from its row.
#[derive(Debug, Clone, PartialEq)]
pub struct Member {
    /// Seat of the instance.
    pub seat: Seat,
    /// Time until its lease ends, by the database's clock; zero once it has ended.
    pub lease_left: Duration,
    /// True if it has left or was declared dead: its robots and duties are free.
    pub is_ended: bool,
    /// Weight in the distribution of robots.
    pub capacity: u32,
    /// True if it hands its robots over, because it is about to end.
    pub draining: bool,
    /// True if it is connected to a Zenoh router, so that robots reach it, and its clock is
    /// accurate enough.
    pub linked: bool,
    /// Instances and robots that it receives on Zenoh.
    pub hearing: Hearing,
    /// Address of its HTTP API for other instances.
    pub url: String,
    /// Version of its program.
    pub program: String,
    /// Newest format of a checkpoint that it can read.
    pub checkpoint_format: i64,
    /// Hash of the part of its configuration that all instances must share.
    pub config_sha256: Vec<u8>,
    /// Lead of its wall clock over the database's at its last renewal, ns.
    pub clock_ahead_ns: i64,
    /// Time at which it joined, wall time of the database, ns.
    pub joined_ns: i64,
}

impl Member {
    /// True if a wall clock with this lead over the database's, ns, is accurate enough to estimate
    /// robots, whose times are compared with it.
    pub fn has_right_time(clock_ahead_ns: i64) -> bool {
        u128::from(clock_ahead_ns.unsigned_abs()) <= CLUSTER_CLOCK_USED_UP_TO.as_nanos()
    }

    /// True if its lease has not ended.
    pub fn is_live(&self) -> bool {
        !self.lease_left.is_zero()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_may_be_ten_seconds_off_to_either_side() {
        const LIMIT_NS: i64 = 10_000_000_000;
        for right in [0, LIMIT_NS, -LIMIT_NS] {
            assert!(Member::has_right_time(right));
        }
        for wrong in [LIMIT_NS + 1, -LIMIT_NS - 1, i64::MIN] {
            assert!(!Member::has_right_time(wrong));
        }
    }
}
