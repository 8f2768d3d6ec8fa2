//! Inbox of robots' answers that wait to be stored: a queue for each robot, emptied in turn, so
//! that a flood of one robot does not delay the others.

use std::collections::{BTreeMap, VecDeque};
use std::ops::Bound;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use fleetcal_domain::limits::{
    ANSWERS_HEARD_PER_HOUR_MAX, ANSWERS_OF_ROBOT_MAX, ANSWERS_PER_HOUR_MAX,
};
use fleetcal_fleet::budget::Budget;
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Applied;
use tokio::sync::Notify;

/// Queue of one robot's answers. Only registered robots have one.
#[derive(Debug)]
struct Queue {
    waiting: VecDeque<Applied>,
    heard: Budget,
    news: Budget,
}

impl Default for Queue {
    fn default() -> Self {
        Self {
            waiting: VecDeque::new(),
            heard: Budget::per_hour(ANSWERS_HEARD_PER_HOUR_MAX),
            news: Budget::per_hour(ANSWERS_PER_HOUR_MAX),
        }
    }
}

#[derive(Debug, Default)]
struct Queues {
    of_robots: BTreeMap<RobotId, Queue>,
    /// Robot of the last answer that was removed.
    last: Option<RobotId>,
}

impl Queues {
    /// Removes the next answer, of the next robot that has one.
    fn next(&mut self) -> Option<(RobotId, Applied)> {
        let after = self.last.take();
        let from = after.as_ref().map_or(Bound::Unbounded, Bound::Excluded);
        let has_one = |(_, queue): &(&RobotId, &Queue)| !queue.waiting.is_empty();
        let later = self.of_robots.range::<RobotId, _>((from, Bound::Unbounded));
        let mut in_turn = later.chain(self.of_robots.iter());
        let robot = in_turn.find(has_one).map(|(robot, _)| robot.clone())?;
        let answer = self.of_robots.get_mut(&robot)?.waiting.pop_front()?;
        self.last = Some(robot.clone());
        Some((robot, answer))
    }
}

/// Inbox of robots' answers.
#[derive(Debug, Default)]
pub(super) struct Inbox {
    queues: Mutex<Queues>,
    came: Notify,
}

impl Inbox {
    /// Lock of the queues. They are consistent after every statement, so that the panic of another
    /// thread leaves no partial change.
    fn lock(&self) -> MutexGuard<'_, Queues> {
        self.queues.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Queues an answer at `now`, running time. Returns `false` if one was dropped: this one if the
    /// robot has exhausted its budget, or else its oldest one. It never blocks.
    pub(super) fn put(&self, robot: &RobotId, answer: Applied, now: Duration) -> bool {
        let kept = {
            let mut queues = self.lock();
            let queue = queues.of_robots.entry(robot.clone()).or_default();
            if queue.waiting.contains(&answer) {
                return true;
            }
            if !queue.heard.take(now, 1) {
                return false;
            }
            let is_full = queue.waiting.len() >= ANSWERS_OF_ROBOT_MAX;
            if is_full {
                queue.waiting.pop_front();
            }
            queue.waiting.push_back(answer);
            !is_full
        };
        self.came.notify_one();
        kept
    }

    /// True if a robot may still change its records by new answers in this hour.
    pub(super) fn has_room_for_news(&self, robot: &RobotId, now: Duration) -> bool {
        let mut queues = self.lock();
        let queue = queues.of_robots.entry(robot.clone()).or_default();
        queue.news.take(now, 1)
    }

    /// Waits for the next answer.
    pub(super) async fn next(&self) -> (RobotId, Applied) {
        loop {
            let came = self.came.notified();
            if let Some(next) = self.lock().next() {
                return next;
            }
            came.await;
        }
    }
}

#[cfg(test)]
mod tests {
    use fleetcal_model::{Generation, RobotTime};
    use fleetcal_proto::calibration::AppliedStatus;

    use super::*;

    fn robot(name: &str) -> RobotId {
        RobotId::parse(name).unwrap()
    }

    fn answer(generation: Generation) -> Applied {
        Applied {
            generation,
            sha256: String::new(),
            status: AppliedStatus::Applied,
            reason: None,
            applied_at_ns: RobotTime(0),
            values: None,
        }
    }

    #[tokio::test]
    async fn a_flood_of_one_robot_keeps_nobody_waiting() {
        let inbox = Inbox::default();
        let now = Duration::from_secs(1);
        let lost = (0..70_000)
            .filter(|generation| !inbox.put(&robot("loud"), answer(Generation(*generation)), now))
            .count();
        assert_eq!(lost, 70_000 - ANSWERS_OF_ROBOT_MAX);
        for name in ["a", "b", "z"] {
            assert!(inbox.put(&robot(name), answer(Generation(1)), now));
        }
        let mut first = Vec::new();
        for _ in 0..4 {
            first.push(inbox.next().await.0.to_string());
        }
        assert_eq!(first, ["a", "b", "loud", "z"]);
    }

    #[tokio::test]
    async fn the_latest_answers_of_a_robot_are_kept_in_their_order() {
        let inbox = Inbox::default();
        let now = Duration::from_secs(1);
        for generation in 0..10 {
            inbox.put(&robot("a"), answer(Generation(generation)), now);
        }
        for expected in 6..10 {
            assert_eq!(inbox.next().await.1.generation, Generation(expected));
        }
        // The same again waits once.
        assert!(inbox.put(&robot("a"), answer(Generation(1)), now));
        assert!(inbox.put(&robot("a"), answer(Generation(1)), now));
        inbox.next().await;
        let nothing = tokio::time::timeout(Duration::from_millis(20), inbox.next()).await;
        assert!(nothing.is_err());
    }

    #[test]
    fn news_end_with_the_hours_budget() {
        let inbox = Inbox::default();
        let at = |minutes: u64| Duration::from_secs(60 * minutes);
        let taken = (0..1_000).filter(|_| inbox.has_room_for_news(&robot("a"), at(1)));
        assert_eq!(taken.count(), ANSWERS_PER_HOUR_MAX as usize);
        assert!(inbox.has_room_for_news(&robot("b"), at(1)));
        assert!(inbox.has_room_for_news(&robot("a"), at(5)));
    }
}
