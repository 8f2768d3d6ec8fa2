//! The one place where time enters the service.
//!
//! Estimation runs on message time alone. The wall clock says when a message was received, whether
//! a robot is stale, and how old a row of the history is.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use fleetcal_model::WallTime;

/// A source of time.
pub trait Clock: std::fmt::Debug + Send + Sync + 'static {
    /// Returns the wall time. It may jump.
    fn now(&self) -> WallTime;

    /// Returns the time since the clock was made. It never goes back.
    fn elapsed(&self) -> Duration;

    /// Returns the time since the machine was started, which includes its sleep: leases run on it.
    fn uptime(&self) -> Duration;
}

/// A shared clock.
pub type SharedClock = Arc<dyn Clock>;

/// The machine's clocks.
#[derive(Debug, Clone, Copy)]
pub struct SystemClock {
    started: Instant,
}

impl SystemClock {
    /// Makes a clock whose [`Clock::elapsed`] begins now.
    #[expect(clippy::disallowed_methods, reason = "this is where time enters")]
    pub fn start() -> Self {
        Self {
            started: Instant::now(),
        }
    }
}

impl Clock for SystemClock {
    #[expect(clippy::disallowed_methods, reason = "this is where time enters")]
    fn now(&self) -> WallTime {
        // A machine set before 1970 has no clock worth the name.
        let since = SystemTime::now().duration_since(UNIX_EPOCH);
        WallTime::default().plus(since.unwrap_or_default())
    }

    fn elapsed(&self) -> Duration {
        self.started.elapsed()
    }

    fn uptime(&self) -> Duration {
        duration_of(rustix::time::clock_gettime(rustix::time::ClockId::Boottime))
    }
}

/// A clock that advances on command only.
#[derive(Debug, Default)]
pub struct MockClock {
    wall_ns: AtomicI64,
    elapsed_ns: AtomicU64,
}

impl MockClock {
    /// Makes a clock that shows `wall_ns` and has not run yet.
    pub fn at(wall_ns: i64) -> Arc<Self> {
        Arc::new(Self {
            wall_ns: AtomicI64::new(wall_ns),
            elapsed_ns: AtomicU64::new(0),
        })
    }

    /// Advances both clocks by `step`.
    pub fn advance(&self, step: Duration) {
        let step_ns = u64::try_from(step.as_nanos()).unwrap_or(u64::MAX);
        self.elapsed_ns.fetch_add(step_ns, Ordering::SeqCst);
        self.wall_ns
            .fetch_add(i64::try_from(step_ns).unwrap_or(i64::MAX), Ordering::SeqCst);
    }

    /// Sets the wall clock alone, as an operator or NTP would.
    pub fn set_wall_ns(&self, wall_ns: i64) {
        self.wall_ns.store(wall_ns, Ordering::SeqCst);
    }
}

impl Clock for MockClock {
    fn now(&self) -> WallTime {
        WallTime(self.wall_ns.load(Ordering::SeqCst))
    }

    fn elapsed(&self) -> Duration {
        Duration::from_nanos(self.elapsed_ns.load(Ordering::SeqCst))
    }

    fn uptime(&self) -> Duration {
        self.elapsed()
    }
}

/// Returns the CPU time that this thread has used. It measures work, and decisions do not depend on
/// it.
pub fn thread_cpu() -> Duration {
    duration_of(rustix::time::clock_gettime(
        rustix::time::ClockId::ThreadCPUTime,
    ))
}

fn duration_of(time: rustix::time::Timespec) -> Duration {
    let seconds = u64::try_from(time.tv_sec).unwrap_or(0);
    Duration::from_secs(seconds) + Duration::from_nanos(u64::try_from(time.tv_nsec).unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_wall_clock_does_not_move_the_running_time() {
        let clock = MockClock::at(1_000);
        clock.advance(Duration::from_nanos(5));
        clock.set_wall_ns(10);
        assert_eq!(
            (clock.now(), clock.elapsed()),
            (WallTime(10), Duration::from_nanos(5))
        );
    }

    #[test]
    fn the_system_clock_is_after_2020() {
        assert!(SystemClock::start().now() > WallTime(1_577_836_800_000_000_000));
    }
}
