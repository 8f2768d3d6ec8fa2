//! Time: of robots, and of the service.
//!
//! They are two types because they are two clocks. Estimation runs on a robot's time alone; the
//! service's wall time says when something was received, decided or due. What compares the two does
//! so by name, through nanoseconds.

use std::time::Duration;

use serde::{Deserialize, Serialize};

const NS_PER_S: i64 = 1_000_000_000;

/// A point in a robot's time: nanoseconds since the Unix epoch by the robot's own clock.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(transparent)]
pub struct RobotTime(pub i64);

impl RobotTime {
    /// Returns the whole seconds since the Unix epoch.
    pub const fn whole_s(self) -> i64 {
        self.0.div_euclid(NS_PER_S)
    }

    /// Returns the seconds from `earlier` to `self`; negative if `self` is the earlier one.
    #[inline]
    pub fn seconds_since(self, earlier: Self) -> f64 {
        self.0.saturating_sub(earlier.0) as f64 * 1e-9
    }

    /// Returns the time `by` later.
    #[must_use]
    pub fn plus(self, by: Duration) -> Self {
        Self(self.0.saturating_add(nanoseconds(by)))
    }

    /// Returns the time `seconds` later.
    #[must_use]
    #[inline]
    pub fn plus_seconds(self, seconds: f64) -> Self {
        Self(self.0.saturating_add((seconds * 1e9).round() as i64))
    }
}

/// A point in wall time: nanoseconds since the Unix epoch by the service's clock. That clock may be
/// set, so a later reading may be an earlier time.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(transparent)]
pub struct WallTime(pub i64);

impl WallTime {
    /// The end of time, 2262.
    pub const MAX: Self = Self(i64::MAX);

    /// Returns the time `by` later, at most [`WallTime::MAX`].
    #[must_use]
    pub fn plus(self, by: Duration) -> Self {
        Self(self.0.saturating_add(nanoseconds(by)))
    }

    /// Returns the time `by` earlier.
    #[must_use]
    pub fn minus(self, by: Duration) -> Self {
        Self(self.0.saturating_sub(nanoseconds(by)))
    }

    /// Returns the whole seconds since the Unix epoch.
    pub const fn whole_s(self) -> i64 {
        self.0.div_euclid(NS_PER_S)
    }

    /// Returns the nanoseconds from `earlier` to `self`; negative if `self` is the earlier one.
    pub const fn ns_since(self, earlier: Self) -> i64 {
        self.0.saturating_sub(earlier.0)
    }
}

fn nanoseconds(duration: Duration) -> i64 {
    i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX)
}
