//! Renewal of the lease.

use std::sync::atomic::Ordering;
use std::time::Duration;

use fleetcal_cluster::{Member, Seat};
use fleetcal_domain::limits;
use fleetcal_model::WallTime;
use fleetcal_store::StoreError;
use fleetcal_store::cluster::Renewal;
use tokio::time::MissedTickBehavior;

use super::Ownership;

/// Renews the lease until the cluster is left.
pub(super) async fn renew(ownership: Ownership) {
    let mut ticks = tokio::time::interval(limits::CLUSTER_RENEW_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut draining = ownership.inner.draining.subscribe();
    let mut link = ownership.inner.setup.link.clone();
    let mut hearing = ownership.inner.hearing.subscribe();
    loop {
        // What others have to know at once does not wait for the next renewal.
        tokio::select! {
            () = ownership.inner.stop.cancelled() => return,
            _ = ticks.tick() => {}
            changed = draining.changed() => if changed.is_err() { return },
            changed = link.changed() => if changed.is_err() { return },
            changed = hearing.changed() => if changed.is_err() { return },
        }
        let Some(seat) = ownership.inner.cluster.seat() else {
            continue;
        };
        if let Err(error) = ownership.renew_once(&seat).await {
            ownership.note_connected(None);
            tracing::warn!(%error, "the lease was not renewed");
        }
    }
}

impl Ownership {
    async fn renew_once(&self, seat: &Seat) -> Result<(), StoreError> {
        let setup = &self.inner.setup;
        let asked_at = setup.clock.uptime();
        let now = setup.clock.now();
        let renewal = Renewal {
            // Robots' times are compared with wall time: who has it wrong is of no use to them.
            linked: setup.link.borrow().linked && self.has_right_time(),
            draining: *self.inner.draining.borrow(),
            clock_ahead_ns: self.inner.clock_ahead_ns.load(Ordering::Relaxed),
            hearing: self.inner.hearing.borrow().clone(),
        };
        if let Some(database_now) = self.inner.registry.renew(seat, renewal).await? {
            let answered = setup.clock.now();
            self.note_clock(least_ahead_ns(now, database_now, answered));
            self.inner.cluster.answered(asked_at);
            self.note_connected(Some(asked_at));
            if self.inner.cluster.seat().as_ref() == Some(seat) {
                self.inner.cluster.lease().renewed(asked_at);
            }
        } else {
            self.inner.cluster.lease().lost();
            self.inner.seat_lost.notify_one();
        }
        Ok(())
    }
}

impl Ownership {
    fn note_clock(&self, ahead_ns: i64) {
        let before_ns = self.inner.clock_ahead_ns.swap(ahead_ns, Ordering::Relaxed);
        let is_off = |ns: i64| ns.unsigned_abs() > nanoseconds(limits::CLUSTER_CLOCK_WARNED_BEYOND);
        if is_off(ahead_ns) && !is_off(before_ns) {
            let ahead_s = ahead_ns as f64 / 1e9;
            tracing::warn!(ahead_s, "the clock differs from the database's");
        }
    }

    fn has_right_time(&self) -> bool {
        Member::has_right_time(self.inner.clock_ahead_ns.load(Ordering::Relaxed))
    }
}

/// Least lead of a wall clock over the database's, ns: the database's time is of some moment
/// between request and answer, which are far apart on a slow connection.
fn least_ahead_ns(asked: WallTime, database: WallTime, answered: WallTime) -> i64 {
    let (least, most) = (asked.ns_since(database), answered.ns_since(database));
    if least > most {
        // The clock was set back meanwhile.
        return most;
    }
    0_i64.clamp(least, most)
}

fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_line_is_no_wrong_clock() {
        let ahead = |asked, database, answered| {
            least_ahead_ns(WallTime(asked), WallTime(database), WallTime(answered))
        };
        assert_eq!(ahead(100, 900, 1_000), 0, "the question took long");
        assert_eq!(ahead(100, 150, 1_000), 0, "the answer did");
        assert_eq!(ahead(100, 3_000, 200), -2_800);
        assert_eq!(ahead(5_000, 3_000, 5_100), 2_000);
        assert_eq!(ahead(5_000, 3_000, 2_000), -1_000, "it was set back");
    }
}
