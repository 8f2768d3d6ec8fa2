//! Delay before a task tries again after a commit that failed.

use std::time::Duration;

use fleetcal_domain::limits;
use tokio::time::Instant;

/// Pause between two commits: absent while they succeed, and longer with each that fails.
#[derive(Debug, Default)]
pub(crate) struct Retry {
    pause: Duration,
    at: Option<Instant>,
}

impl Retry {
    /// Lengthens the pause after a commit that failed at `now`.
    pub(crate) fn failed(&mut self, now: Instant) {
        self.pause = (self.pause * 2).clamp(limits::STORE_RETRY_FIRST, limits::STORE_RETRY_MAX);
        self.at = Some(now + self.pause);
    }

    /// Resets the pause.
    pub(crate) fn reset(&mut self) {
        *self = Self::default();
    }

    /// Earliest begin of the next commit; `None` if it may begin at once.
    pub(crate) fn at(&self) -> Option<Instant> {
        self.at
    }
}

/// Waits until an instant; returns at once without one.
pub(crate) async fn pause_until(at: Option<Instant>) {
    if let Some(at) = at {
        tokio::time::sleep_until(at).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pause_grows_to_its_limit_and_ends_with_success() {
        let now = Instant::now();
        let mut retry = Retry::default();
        assert_eq!(retry.at(), None);
        let mut pauses = Vec::new();
        for _ in 0..6 {
            retry.failed(now);
            pauses.push((retry.at().unwrap() - now).as_millis());
        }
        assert_eq!(pauses, [100, 200, 400, 800, 1_000, 1_000]);
        retry.reset();
        assert_eq!(retry.at(), None);
    }
}
