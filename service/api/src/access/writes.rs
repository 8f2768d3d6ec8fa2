//! Limits of the changes by one user or token per time. Each change may leave rows in the audit,
//! which are kept for ever.

use axum::http::StatusCode;
use fleetcal_http::{Turned, WritesExceeded};

use super::Caller;
use crate::ApiState;
use crate::problem::Problem;

/// Counts writes of a caller.
///
/// # Errors
/// [`Problem`] if there were too many; none of them counts then.
pub(crate) fn count(api: &ApiState, caller: &Caller, writes: u32) -> Result<(), Problem> {
    let now = api.clock.elapsed();
    let counted = api.access.writes.count(&caller.actor.key(), writes, now);
    counted.map_err(|exceeded| refused(api, caller, exceeded))
}

fn refused(api: &ApiState, caller: &Caller, exceeded: WritesExceeded) -> Problem {
    api.connections.count(Turned::CallerWrites);
    let wait_s = exceeded.wait.as_secs_f64().ceil();
    let name = &*caller.actor.name;
    if exceeded.is_news {
        tracing::warn!(name, "a user or token changes too much, and is refused");
    }
    let detail = format!("{name} has changed too much; try again in {wait_s} s");
    let status = StatusCode::TOO_MANY_REQUESTS;
    Problem::new(status, "too_many_writes", detail).retry_after(wait_s as u32)
}
