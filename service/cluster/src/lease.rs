//! Lease of an instance: the time for which it may assume that it has its robots.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use fleetcal_domain::limits::{CLUSTER_LEASE, CLUSTER_LEASE_MARGIN};

/// View of an instance on its own lease. The database ends a lease [`CLUSTER_LEASE`] after it ran
/// the renewal; the instance stops acting [`CLUSTER_LEASE_MARGIN`] before that, counted from its
/// request. Both use clocks that run on while a machine sleeps.
///
/// All senders share it: each publication about a robot checks [`Lease::holds`] in the line before.
#[derive(Debug, Default)]
pub struct Lease {
    /// Running time up to which the lease is trusted, ns; 0 without a lease.
    trusted_until_ns: AtomicU64,
}

impl Lease {
    /// Running time up to which a renewal that was requested at `asked_at` (running time) is
    /// trusted.
    pub const fn trusted_after(asked_at: Duration) -> Duration {
        asked_at.saturating_add(CLUSTER_LEASE.saturating_sub(CLUSTER_LEASE_MARGIN))
    }

    /// Records that a renewal was granted, which was requested at `asked_at`.
    pub fn renewed(&self, asked_at: Duration) {
        let until_ns = Self::trusted_after(asked_at).as_nanos();
        let until_ns = u64::try_from(until_ns).unwrap_or(u64::MAX);
        self.trusted_until_ns.fetch_max(until_ns, Ordering::SeqCst);
    }

    /// Records that another instance has declared this one dead.
    pub fn lost(&self) {
        self.trusted_until_ns.store(0, Ordering::SeqCst);
    }

    /// True if the instance may act on its robots at `now`, running time.
    pub fn holds(&self, now: Duration) -> bool {
        now < self.trusted_until()
    }

    /// Running time up to which it may.
    pub fn trusted_until(&self) -> Duration {
        Duration::from_nanos(self.trusted_until_ns.load(Ordering::SeqCst))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_ends_before_the_database_ends_it() {
        let lease = Lease::default();
        let asked_at = Duration::from_secs(100);
        assert!(!lease.holds(Duration::ZERO));
        lease.renewed(asked_at);
        let last = asked_at + CLUSTER_LEASE.checked_sub(CLUSTER_LEASE_MARGIN).unwrap();
        assert!(lease.holds(last.checked_sub(Duration::from_nanos(1)).unwrap()));
        assert!(!lease.holds(last));
        assert!(last < asked_at + CLUSTER_LEASE);
    }

    #[test]
    fn an_answer_that_was_overtaken_shortens_nothing() {
        let lease = Lease::default();
        lease.renewed(Duration::from_secs(102));
        lease.renewed(Duration::from_secs(100));
        assert!(lease.holds(Duration::from_secs(106)));
    }

    #[test]
    fn who_was_taken_for_dead_stops_at_once() {
        let lease = Lease::default();
        lease.renewed(Duration::from_secs(100));
        lease.lost();
        assert!(!lease.holds(Duration::from_secs(100)));
    }
}
