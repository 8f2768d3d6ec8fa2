//! Budget that fills up again with time, and the rate at which a loss is
//! logged.

use std::collections::BTreeMap;
use std::time::Duration;

use fleetcal_model::RobotId;

use fleetcal_domain::limits::{LOSSES_LOGGED_EVERY, LOSSES_LOGGED_MAX};

/// Hourly budget, full at first, that refills evenly with time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Budget {
    per_hour: f64,
    left: f64,
    /// Running time at which `left` was computed.
    at: Duration,
}

impl Budget {
    /// Makes a full budget of `per_hour` units for an hour.
    pub fn per_hour(per_hour: u32) -> Self {
        Self {
            per_hour: f64::from(per_hour),
            left: f64::from(per_hour),
            at: Duration::ZERO,
        }
    }

    /// Spends `amount` at running time `now`; returns `false` and spends nothing if less is left.
    pub fn take(&mut self, now: Duration, amount: u32) -> bool {
        let passed_h = now.saturating_sub(self.at).as_secs_f64() / 3_600.0;
        self.left = passed_h
            .mul_add(self.per_hour, self.left)
            .min(self.per_hour);
        self.at = self.at.max(now);
        // A whole one that has filled up in parts counts as whole.
        let fits = self.left + 1e-6 >= f64::from(amount);
        if fits {
            self.left -= f64::from(amount);
        }
        fits
    }
}

/// Rate limit of logged losses: one a minute for each robot and kind, and at most
/// [`LOSSES_LOGGED_MAX`] a minute for all robots together. All losses are counted elsewhere.
#[derive(Debug, Default)]
pub struct LossLog {
    /// Time of the last logged loss, and number of losses since, for each robot and kind.
    of_robots: BTreeMap<(Option<RobotId>, &'static str), (Duration, u64)>,
    /// Start of the current minute, and number of losses logged in it.
    minute: (Duration, usize),
}

impl LossLog {
    /// Counts a loss at running time `now`. Returns `Some` if it is to be logged, with the number
    /// of unlogged losses of the same kind before it. Unregistered robots share the key `None`, so
    /// that there are at most robots × kinds entries.
    pub fn take(
        &mut self,
        robot: Option<&RobotId>,
        kind: &'static str,
        now: Duration,
    ) -> Option<u64> {
        if now.saturating_sub(self.minute.0) >= LOSSES_LOGGED_EVERY {
            self.minute = (now, 0);
        }
        let is_full = self.minute.1 >= LOSSES_LOGGED_MAX;
        let entry = self.of_robots.entry((robot.cloned(), kind));
        let before = match entry {
            std::collections::btree_map::Entry::Vacant(new) => {
                new.insert((now, u64::from(is_full)));
                (!is_full).then_some(0)
            }
            std::collections::btree_map::Entry::Occupied(mut known) => {
                let (logged, unsaid) = known.get_mut();
                if is_full || now.saturating_sub(*logged) < LOSSES_LOGGED_EVERY {
                    *unsaid += 1;
                    None
                } else {
                    *logged = now;
                    Some(std::mem::take(unsaid))
                }
            }
        };
        self.minute.1 += usize::from(before.is_some());
        before
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn minutes(minutes: u64) -> Duration {
        Duration::from_secs(60 * minutes)
    }

    #[test]
    fn a_budget_is_used_up_and_fills_up_again() {
        let mut budget = Budget::per_hour(10);
        assert!(budget.take(minutes(0), 10));
        assert!(!budget.take(minutes(0), 1));
        assert!(!budget.take(minutes(5), 1));
        assert!(budget.take(minutes(6), 1));
        assert!(!budget.take(minutes(6), 1));
        // What is not used in an hour is not saved for the next.
        assert!(!budget.take(minutes(600), 11));
        assert!(budget.take(minutes(600), 10));
        // The clock of a process does not go back; if it did, nothing came of it.
        assert!(!budget.take(minutes(0), 1));
    }

    #[test]
    fn a_flood_takes_in_an_hour_what_the_budget_has_and_once_more() {
        let mut budget = Budget::per_hour(20);
        let taken = (0..360_000_u64)
            .filter(|at| budget.take(Duration::from_millis(at * 10), 1))
            .count();
        assert!((39..=40).contains(&taken), "{taken}");
    }

    #[test]
    fn of_a_robot_and_kind_one_loss_a_minute_is_logged_with_those_before_it() {
        let mut log = LossLog::default();
        let robot = RobotId::parse("tugger_01").unwrap();
        assert_eq!(log.take(Some(&robot), "answer", minutes(0)), Some(0));
        for _ in 0..1_000 {
            assert_eq!(log.take(Some(&robot), "answer", minutes(0)), None);
        }
        assert_eq!(log.take(Some(&robot), "note", minutes(0)), Some(0));
        assert_eq!(log.take(Some(&robot), "answer", minutes(1)), Some(1_000));
    }

    #[test]
    fn all_robots_together_log_no_more_than_the_limit() {
        let mut log = LossLog::default();
        let robots: Vec<_> = (0..500)
            .map(|number| RobotId::parse(&format!("r{number}")).unwrap())
            .collect();
        for minute in 0..3 {
            let logged = robots
                .iter()
                .filter(|robot| log.take(Some(robot), "answer", minutes(minute)).is_some())
                .count();
            assert_eq!(logged, LOSSES_LOGGED_MAX, "minute {minute}");
        }
    }
}
