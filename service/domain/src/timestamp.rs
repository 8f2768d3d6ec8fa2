//! Times in documents and messages: RFC 3339 in UTC.

use fleetcal_model::{RobotTime, WallTime};
use jiff::Timestamp;

/// Wall time in a document's form.
pub fn of(wall: WallTime) -> Timestamp {
    of_ns(wall.0)
}

/// Wall time of a document's timestamp; `None` before 1677 or after 2262.
pub fn wall(timestamp: Timestamp) -> Option<WallTime> {
    i64::try_from(timestamp.as_nanosecond()).ok().map(WallTime)
}

/// Robot's time in a document's form.
pub fn of_robot(stamp: RobotTime) -> Timestamp {
    of_ns(stamp.0)
}

/// Nanoseconds since the Unix epoch, of either clock, in a document's form.
pub fn of_ns(ns: i64) -> Timestamp {
    // Every such number is a year between 1677 and 2262, all of which a time can hold.
    Timestamp::from_nanosecond(i128::from(ns)).unwrap_or(Timestamp::UNIX_EPOCH)
}
