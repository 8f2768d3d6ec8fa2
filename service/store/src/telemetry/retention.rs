//! Age of a row for retention: a stepped clock must not delete young rows.

use std::time::Duration;

use fleetcal_domain::limits;
use fleetcal_model::WallTime;

const NS_PER_S: i64 = 1_000_000_000;

/// Compares wall time with running time. A wall clock that was set forward makes every row look
/// old, so nothing is deleted until the clock has stayed there for
/// [`limits::CLOCK_STEP_BELIEVED_AFTER`], or was set back.
#[derive(Debug, Default)]
pub(super) struct Retention {
    /// Wall time at which running time was zero, by the believed clock.
    believed_origin: Option<WallTime>,
    /// Running time at which the wall clock was found ahead.
    stepped_at: Option<Duration>,
}

impl Retention {
    /// True if rows may be deleted by their age, at wall time `now` and running time `elapsed`.
    pub(super) fn may_delete(&mut self, now: WallTime, elapsed: Duration) -> bool {
        let origin = now.minus(elapsed);
        let believed_origin = *self.believed_origin.get_or_insert(origin);
        let ahead_s = origin.ns_since(believed_origin) / NS_PER_S;
        if ahead_s < limits::CLOCK_STEP_S {
            // A clock that was set back, or is corrected by little, makes no row look too old.
            self.believed_origin = Some(origin);
            self.stepped_at = None;
            return true;
        }
        let stepped_at = *self.stepped_at.get_or_insert_with(|| {
            tracing::warn!(
                ahead_s,
                "the clock was set forward: no history is deleted for a day, unless it is set back"
            );
            elapsed
        });
        let believed = elapsed.saturating_sub(stepped_at) >= limits::CLOCK_STEP_BELIEVED_AFTER;
        if believed {
            self.believed_origin = Some(origin);
            self.stepped_at = None;
        }
        believed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DAY: Duration = Duration::from_hours(24);
    const NOON: WallTime = WallTime(1_800_000_000 * NS_PER_S);

    fn after(elapsed: Duration, step: Duration) -> WallTime {
        NOON.plus(elapsed + step)
    }

    #[test]
    fn a_clock_that_runs_lets_rows_age() {
        let mut retention = Retention::default();
        for day in 0..40 {
            assert!(retention.may_delete(after(DAY * day, Duration::ZERO), DAY * day));
        }
    }

    #[test]
    fn a_step_forward_deletes_nothing_for_a_day() {
        let mut retention = Retention::default();
        let second = Duration::from_secs(1);
        assert!(retention.may_delete(after(second, Duration::ZERO), second));
        for hours in 0..24 {
            let elapsed = second * 2 + Duration::from_hours(hours);
            assert!(!retention.may_delete(after(elapsed, DAY * 30), elapsed));
        }
        let elapsed = second * 2 + DAY;
        assert!(retention.may_delete(after(elapsed, DAY * 30), elapsed));
    }

    #[test]
    fn a_clock_that_is_set_back_is_believed_at_once() {
        let mut retention = Retention::default();
        let second = Duration::from_secs(1);
        assert!(retention.may_delete(NOON, Duration::ZERO));
        assert!(!retention.may_delete(after(second, DAY * 30), second));
        assert!(retention.may_delete(after(second * 2, Duration::ZERO), second * 2));
        assert!(retention.may_delete(NOON.minus(DAY * 30), second * 3));
        // It comes right again by a step forward, which is not believed for a day.
        assert!(!retention.may_delete(after(second * 4, Duration::ZERO), second * 4));
    }
}
