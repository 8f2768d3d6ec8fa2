//! Times as documents give them: RFC 3339 in UTC.

pub use fleetcal_domain::timestamp::{of, of_ns, of_robot, wall};
use jiff::Timestamp;

/// Converts seconds since the Unix epoch to a time.
pub fn of_seconds(seconds: i64) -> Timestamp {
    of_ns(seconds.saturating_mul(1_000_000_000))
}
