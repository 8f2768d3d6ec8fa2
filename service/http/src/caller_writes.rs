//! Limits of how often one user or token changes something.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use fleetcal_domain::limits;

use crate::Throttle;

/// Counters of each caller's writes.
#[derive(Debug)]
pub struct CallerWrites {
    writes: Mutex<Throttle>,
    /// Throttle of log lines about refusals.
    logged: Mutex<Throttle>,
}

/// Refusal of a caller that writes too often.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WritesExceeded {
    /// Time until as many writes are admitted again.
    pub wait: Duration,
    /// True if it is to be logged: the first time, and once in a while after that.
    pub is_news: bool,
}

impl Default for CallerWrites {
    fn default() -> Self {
        let throttle =
            |every, burst| Mutex::new(Throttle::new(every, burst, limits::CALLER_WRITES_KEYS_MAX));
        Self {
            writes: throttle(limits::CALLER_WRITES_EVERY, limits::CALLER_WRITES_BURST),
            logged: throttle(limits::CALLER_WRITES_LOGGED_EVERY, 1),
        }
    }
}

impl CallerWrites {
    /// Counts `writes` of a caller at running time `now`: all of them or none.
    ///
    /// # Errors
    /// [`WritesExceeded`] if there were too many.
    pub fn count(&self, caller: &str, writes: u32, now: Duration) -> Result<(), WritesExceeded> {
        let counted = of(&self.writes, |throttle| {
            throttle.take_several(caller, writes, now)
        });
        counted.map_err(|wait| WritesExceeded {
            wait,
            is_news: of(&self.logged, |throttle| throttle.take(caller, now)).is_ok(),
        })
    }
}

fn of<T>(throttle: &Mutex<Throttle>, take: impl FnOnce(&mut Throttle) -> T) -> T {
    take(&mut throttle.lock().unwrap_or_else(PoisonError::into_inner))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_caller_in_a_loop_is_slowed_down_and_nobody_else() {
        let writes = CallerWrites::default();
        let mut now = Duration::from_secs(1);
        let mut taken = 0;
        let mut news = 0;
        // 174 proposals a second, for an hour.
        for _ in 0..3_600 * 174 {
            match writes.count("loop", 1, now) {
                Ok(()) => taken += 1,
                Err(exceeded) => news += u32::from(exceeded.is_news),
            }
            now += Duration::from_secs(1) / 174;
        }
        assert!(taken <= limits::CALLER_WRITES_BURST + 3_601, "{taken}");
        assert!((59..=61).contains(&news), "{news} lines");
        assert_eq!(writes.count("person", 64, now), Ok(()));
    }
}
