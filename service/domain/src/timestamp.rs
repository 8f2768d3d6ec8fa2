//! Times as documents and messages give them: RFC 3339 in UTC.

use fleetcal_model::{RobotTime, WallTime};
use jiff::Timestamp;

/// A wall time as a document gives it.
pub fn of(wall: WallTime) -> Timestamp {
    of_ns(wall.0)
}

/// The wall time that a document gives; `None` before 1677 or after 2262.
pub fn wall(timestamp: Timestamp) -> Option<WallTime> {
    i64::try_from(timestamp.as_nanosecond()).ok().map(WallTime)
}

/// A robot's time as a document gives it.
pub fn of_robot(stamp: RobotTime) -> Timestamp {
    of_ns(stamp.0)
}

/// Nanoseconds since the Unix epoch, of either clock, as a document gives them.
pub fn of_ns(ns: i64) -> Timestamp {
    // Every such number is a year between 1677 and 2262, all of which a time can hold.
    Timestamp::from_nanosecond(i128::from(ns)).unwrap_or(Timestamp::UNIX_EPOCH)
}
