//! Retirement of a robot, whose messages are refused from then on.

use std::sync::atomic::Ordering;

use super::Robot;

impl Robot {
    /// Sets the retirement.
    pub fn set_retired(&self, retired: bool) {
        self.retired.store(retired, Ordering::Relaxed);
    }

    /// True while it is retired.
    pub fn is_retired(&self) -> bool {
        self.retired.load(Ordering::Relaxed)
    }
}
