//! Times as documents give them: RFC 3339 in UTC.

use jiff::Timestamp;

/// Nanoseconds since the Unix epoch as a time.
pub fn of_ns(ns: i64) -> Timestamp {
    // Every such number is a year between 1677 and 2262, all of which a time can hold.
    Timestamp::from_nanosecond(i128::from(ns)).unwrap_or(Timestamp::UNIX_EPOCH)
}

/// Seconds since the Unix epoch as a time.
pub fn of_seconds(seconds: i64) -> Timestamp {
    of_ns(seconds.saturating_mul(1_000_000_000))
}
