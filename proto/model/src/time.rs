//! Time.

use serde::{Deserialize, Serialize};

/// A point in message time: nanoseconds since the Unix epoch, as the robot's own clock stamps it.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
pub struct Stamp(pub i64);

impl Stamp {
    /// Seconds from `earlier` to `self`; negative when `self` is the earlier one.
    #[inline]
    pub fn seconds_since(self, earlier: Self) -> f64 {
        self.0.saturating_sub(earlier.0) as f64 * 1e-9
    }

    /// The stamp `seconds` later.
    #[must_use]
    #[inline]
    pub fn plus_seconds(self, seconds: f64) -> Self {
        Self(self.0.saturating_add((seconds * 1e9).round() as i64))
    }
}
