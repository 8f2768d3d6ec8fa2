//! The instances of a cluster.

use std::time::Duration;

use fleetcal_domain::limits::CLUSTER_CLOCK_USED_UP_TO;

use crate::hearing::Hearing;
use crate::tenure::Seat;

/// An instance as its row says.
#[derive(Debug, Clone, PartialEq)]
pub struct Member {
    /// Which life of which instance.
    pub seat: Seat,
    /// Time until its lease ends, by the database's clock; zero once it has ended.
    pub lease_left: Duration,
    /// Whether it has left, or was taken for dead: what it had is free.
    pub is_ended: bool,
    /// Its share of the robots against that of others.
    pub capacity: u32,
    /// Whether it gives its robots away, because it is about to end.
    pub draining: bool,
    /// Whether it reaches a Zenoh router, so that robots reach it, and its clock is right enough.
    pub linked: bool,
    /// Instances and robots that it hears on Zenoh.
    pub hearing: Hearing,
    /// Where other instances reach its HTTP API.
    pub url: String,
    /// Version of its program.
    pub program: String,
    /// The newest format of a checkpoint that it can read.
    pub checkpoint_format: i64,
    /// Hash of the part of its configuration in which instances have to agree.
    pub config_sha256: Vec<u8>,
    /// By how much its wall clock was ahead of the database's at its last renewal, ns.
    pub clock_ahead_ns: i64,
    /// When it joined, wall time of the database, ns.
    pub joined_ns: i64,
}

impl Member {
    /// Whether a wall clock that is so far ahead of the database's, ns, is right enough to estimate robots by:
    /// their times are compared with it.
    pub fn has_right_time(clock_ahead_ns: i64) -> bool {
        u128::from(clock_ahead_ns.unsigned_abs()) <= CLUSTER_CLOCK_USED_UP_TO.as_nanos()
    }

    /// Whether its lease has not ended.
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
