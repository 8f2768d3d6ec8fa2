//! Detection of two senders that use one robot's id.
//!
//! Zenoh does not say who put a sample, so stamps and connections have to tell. One robot's stamps of
//! one stream go up, at a steady rate. Of two robots whose clocks differ, each message goes back
//! behind the other's; of two whose clocks agree, one's stamps fall between the other's, as near to
//! the one before each time. Several of either within a few messages, and there are two.
//!
//! Two whose stamps are one steady row take turns on two connections. A robot that connects again
//! does not come back to the connection before, and what two bridges of one robot bring comes twice.

use std::collections::{HashMap, VecDeque};

use fleetcal_estimator::RobotTime;
use fleetcal_model::Stream;

/// Messages of one stream that are looked at: of two scanners of 10 Hz, a second.
const WINDOW: usize = 20;
/// Share of steps back among these, from which on there are two senders: of a queue that overtakes
/// now and then, it is a few in a hundred.
const BACK_MIN: usize = WINDOW / 4;
/// Shorter of two steps that follow each other, as a share of both: below this, and the same again
/// each time, the stamps are those of two clocks.
const SHORT_SHARE_MAX: f64 = 0.35;
/// How far that share may differ within the window.
const SHORT_SHARE_SPREAD_MAX: f64 = 0.1;
/// How far pairs of steps may differ from their mean, as a share of it: a steady rate.
const PAIR_SPREAD_MAX: f64 = 0.1;
/// A longer pause is one, ns: a robot that stopped sending has lost nothing.
const PAUSE_NS: i64 = 10_000_000_000;
/// Messages of one stream whose connections are looked at: of wheel odometry, two seconds.
const TURNS_WINDOW: usize = 200;
/// How often connections go on after another one among these, from which on there are two senders.
const RETURNS_MIN: usize = 5;
/// Messages without a sign of two senders, after which there is one again.
const CALM_MESSAGES: u32 = 400;

/// The connection that a message came over, as long as that lasts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct LinkId(pub u64);

/// One stream's latest messages: stamp, and the connection that each came over.
#[derive(Debug, Default)]
struct Turns {
    messages: VecDeque<(i64, LinkId)>,
}

impl Turns {
    /// Takes a message; whether it came over another connection than the one before, and the
    /// connections take turns.
    fn take(&mut self, stamp: RobotTime, link: LinkId) -> bool {
        let is_other = self.messages.back().is_some_and(|last| last.1 != link);
        self.messages.push_back((stamp.0, link));
        if self.messages.len() > TURNS_WINDOW {
            self.messages.pop_front();
        }
        is_other && self.are_taken()
    }

    fn are_taken(&self) -> bool {
        let mut times: HashMap<i64, usize> = HashMap::new();
        for (stamp, _) in &self.messages {
            *times.entry(*stamp).or_default() += 1;
        }
        let (mut newest, mut last, mut heard) = (i64::MIN, None, Vec::new());
        let mut returns = 0;
        for (stamp, link) in &self.messages {
            // What is still on its way when a robot connects again comes late.
            if *stamp <= newest || times.get(stamp).is_some_and(|times| *times > 1) {
                continue;
            }
            newest = *stamp;
            let is_known = heard.contains(link);
            returns += usize::from(is_known && last != Some(*link));
            if !is_known {
                heard.push(*link);
            }
            last = Some(*link);
        }
        // Of two bridges each loses a message now and then that the other brings.
        let shared = times.values().filter(|times| **times > 1).count();
        returns >= RETURNS_MIN && returns > shared
    }
}

/// One stream's latest messages: stamp, and a hash of what they say.
#[derive(Debug, Default)]
struct Latest {
    messages: VecDeque<(i64, u64)>,
    turns: Turns,
}

impl Latest {
    /// Takes a message; whether the window now looks like two senders.
    fn take(&mut self, stamp: RobotTime, content: u64, link: Option<LinkId>) -> bool {
        let take_turns = link.is_some_and(|link| self.turns.take(stamp, link));
        self.messages.push_back((stamp.0, content));
        if self.messages.len() <= WINDOW {
            return take_turns;
        }
        self.messages.pop_front();
        let steps: Vec<i64> = self.steps().collect();
        let repeated = self.repeated_with_other_content();
        let back = steps.iter().filter(|step| **step < 0).count();
        take_turns || back + repeated >= BACK_MIN || fall_between(&steps)
    }

    /// How many messages are missing before the newest, by the usual step of those before it.
    fn missing(&self) -> u64 {
        if self.messages.len() < WINDOW {
            return 0;
        }
        let mut steps: Vec<i64> = self.steps().collect();
        let Some(newest) = steps.pop() else {
            return 0;
        };
        steps.sort_unstable();
        let usual = steps.get(steps.len() / 2).copied().unwrap_or_default();
        if usual <= 0 || newest >= PAUSE_NS || newest.saturating_mul(2) < usual.saturating_mul(3) {
            return 0;
        }
        ((newest + usual / 2) / usual - 1).max(0).unsigned_abs()
    }

    fn steps(&self) -> impl Iterator<Item = i64> {
        let later = self.messages.iter().skip(1);
        let both = self.messages.iter().zip(later);
        both.map(|(before, after)| after.0.saturating_sub(before.0))
    }

    /// A message that two middlewares bring is the same twice; two robots' differ.
    fn repeated_with_other_content(&self) -> usize {
        let later = self.messages.iter().skip(1);
        let both = self.messages.iter().zip(later);
        both.filter(|(before, after)| before.0 == after.0 && before.1 != after.1)
            .count()
    }
}

/// Whether every other step is short, and by the same share of a steady pair of steps.
fn fall_between(steps: &[i64]) -> bool {
    if steps.iter().any(|step| *step <= 0) {
        return false;
    }
    let (pairs, _) = steps.as_chunks::<2>();
    let sums: Vec<f64> = pairs.iter().map(|[a, b]| (a + b) as f64).collect();
    let mean = sums.iter().sum::<f64>() / sums.len().max(1) as f64;
    let is_steady = |sum: &f64| (sum - mean).abs() <= PAIR_SPREAD_MAX * mean;
    let shares: Vec<f64> = pairs
        .iter()
        .zip(&sums)
        .map(|([first, _], sum)| *first as f64 / sum)
        .collect();
    let least = shares.iter().copied().fold(1.0, f64::min);
    let most = shares.iter().copied().fold(0.0, f64::max);
    let is_short = most <= SHORT_SHARE_MAX || least >= 1.0 - SHORT_SHARE_MAX;
    is_short && most - least <= SHORT_SHARE_SPREAD_MAX && sums.iter().all(is_steady)
}

/// What the stamps of a robot's streams say of its senders.
#[derive(Debug, Default)]
pub struct Senders {
    latest: [Latest; Stream::COUNT],
    /// Messages since the last sign of two; `None` while there was none.
    calm: Option<u32>,
}

impl Senders {
    /// Takes a message's stamp, a hash of what it says and the connection that it came over, where
    /// that is known; whether two senders use the id.
    pub fn take(
        &mut self,
        stream: Stream,
        stamp: RobotTime,
        content: u64,
        link: Option<LinkId>,
    ) -> bool {
        if stream == Stream::Event {
            return self.are_two();
        }
        let Some(latest) = self.latest.get_mut(stream.index()) else {
            return self.are_two();
        };
        if latest.take(stamp, content, link) {
            self.calm = Some(0);
        } else {
            self.calm = self
                .calm
                .map(|calm| calm + 1)
                .filter(|calm| *calm < CALM_MESSAGES);
        }
        self.are_two()
    }

    /// How many messages of a stream are missing before the one that was taken last.
    pub fn missing(&self, stream: Stream) -> u64 {
        let latest = self.latest.get(stream.index());
        latest
            .filter(|_| !self.are_two())
            .map_or(0, Latest::missing)
    }

    /// Whether two senders use the id.
    pub const fn are_two(&self) -> bool {
        self.calm.is_some()
    }
}

#[cfg(test)]
mod tests {
    use rand::rngs::StdRng;
    use rand::{Rng, SeedableRng};

    use super::*;

    const MS: i64 = 1_000_000;
    const START_NS: i64 = 1_760_000_000_000_000_000;

    /// Messages of one robot in the order of arrival: when, and its stamp.
    fn robot(
        period_ms: i64,
        phase_ns: i64,
        clock_ns: i64,
        jitter_ns: i64,
        seed: u64,
    ) -> Vec<(i64, i64)> {
        let mut random = StdRng::seed_from_u64(seed);
        let at = (0..600).map(|number| {
            let jitter = random.random_range(-jitter_ns..=jitter_ns);
            number * period_ms * MS + phase_ns + jitter
        });
        at.map(|at| (at, START_NS + at + clock_ns)).collect()
    }

    /// How many messages there were when two senders were seen first.
    fn seen_after(mut messages: Vec<(i64, i64)>) -> Option<usize> {
        messages.sort_unstable();
        let mut senders = Senders::default();
        messages.iter().position(|(at, stamp)| {
            senders.take(Stream::WheelOdometry, RobotTime(*stamp), *at as u64, None)
        })
    }

    #[test]
    fn one_robot_is_one_however_its_stamps_jitter() {
        for seed in 0..50 {
            for jitter_us in [0, 100, 1_000, 4_000] {
                let one = robot(10, 0, 0, jitter_us * 1_000, seed);
                assert_eq!(seen_after(one), None, "seed {seed}, {jitter_us} µs");
            }
        }
    }

    #[test]
    fn a_message_that_comes_twice_or_overtakes_now_and_then_is_no_second_sender() {
        let mut senders = Senders::default();
        let mut random = StdRng::seed_from_u64(1);
        let mut stamps: Vec<i64> = (0..2_000)
            .map(|number| START_NS + number * 10 * MS)
            .collect();
        for at in (1..stamps.len()).step_by(25) {
            let other = at - random.random_range(0..=1);
            stamps.swap(at, other);
        }
        for stamp in stamps {
            for _ in 0..2 {
                assert!(!senders.take(Stream::WheelOdometry, RobotTime(stamp), stamp as u64, None));
            }
        }
    }

    #[test]
    fn two_robots_are_seen_within_a_second_whatever_their_clocks_say() {
        for seed in 0..50 {
            let mut random = StdRng::seed_from_u64(seed);
            let phase_ns = random.random_range(0..10 * MS);
            // Beyond a period, as clocks do that nobody has set to each other.
            let clock_ns = random.random_range(20..5_000) * MS * [-1, 1][random.random_range(0..2)];
            let mut both = robot(10, 0, 0, 100_000, seed);
            both.extend(robot(10, phase_ns, clock_ns, 100_000, seed + 1_000));
            let after = seen_after(both);
            assert!(
                after.is_some_and(|messages| messages <= 200),
                "seed {seed}: {after:?}"
            );
        }
    }

    #[test]
    fn two_robots_whose_clocks_agree_are_seen_unless_they_take_exact_turns() {
        for share in [5, 10, 20, 30, 70, 80, 90, 95] {
            let mut both = robot(10, 0, 0, 50_000, 1);
            both.extend(robot(10, share * 10 * MS / 100, 0, 50_000, 2));
            let after = seen_after(both);
            assert!(
                after.is_some_and(|messages| messages <= 200),
                "{share} %: {after:?}"
            );
        }
    }

    /// How many messages there were when two senders were seen first, of messages every 5 ms of
    /// which each came over one of some connections.
    fn seen_on(links: impl IntoIterator<Item = (i64, u64)>) -> Option<usize> {
        let mut senders = Senders::default();
        links.into_iter().position(|(number, link)| {
            let stamp = RobotTime(START_NS + number * 5 * MS);
            let link = Some(LinkId(link));
            senders.take(Stream::WheelOdometry, stamp, number as u64, link)
        })
    }

    #[test]
    fn two_robots_that_take_exact_turns_are_seen_by_their_connections() {
        let one_after_the_other = (0..400).map(|number| (number, number as u64 % 2));
        assert_eq!(seen_on(one_after_the_other), Some(6));
        // One that sends less puts in a message now and then: twice a second.
        let now_and_then = (0..400).map(|number| (number, u64::from(number % 50 == 40)));
        let after = seen_on(now_and_then);
        assert!(after.is_some_and(|messages| messages < 200), "{after:?}");
        // Nothing is known of what came without a connection.
        let mut senders = Senders::default();
        assert!((0..400).all(|number| {
            let stamp = RobotTime(START_NS + number * 5 * MS);
            !senders.take(Stream::WheelOdometry, stamp, number as u64, None)
        }));
    }

    #[test]
    fn a_robot_that_connects_again_is_one() {
        // Each time over a connection of its own, however often.
        let again = (0..400).map(|number| (number, number as u64 / 3));
        assert_eq!(seen_on(again), None);
        // What waited on the connection before is read beside what comes over the next one.
        let late = (0..100).map(|number| (number, 0));
        let next = (100..104).flat_map(|number| [(number, 1), (number - 8, 0)]);
        let both = late.chain(next).chain((104..400).map(|number| (number, 1)));
        assert_eq!(seen_on(both), None);
    }

    #[test]
    fn a_robot_behind_two_bridges_is_one() {
        for seed in 0..50 {
            let mut random = StdRng::seed_from_u64(seed);
            // Either may be first, and each loses one in twenty.
            let messages: Vec<_> = (0..1_000)
                .flat_map(|number| {
                    let first = random.random_range(0..2);
                    [(number, first), (number, 1 - first)]
                })
                .collect();
            let kept = messages.into_iter().filter(|_| random.random_bool(0.95));
            assert_eq!(seen_on(kept), None, "seed {seed}");
        }
    }

    #[test]
    fn messages_that_did_not_come_are_counted_by_the_steps_around_them() {
        let mut senders = Senders::default();
        let mut missing = 0;
        for number in (0..1_000_i64).filter(|number| number % 100 < 90 || *number < 100) {
            senders.take(
                Stream::WheelOdometry,
                RobotTime(START_NS + number * 10 * MS),
                number as u64,
                None,
            );
            missing += senders.missing(Stream::WheelOdometry);
        }
        // Nine times ten; the last gap has no message behind it.
        assert_eq!(missing, 80);
        // A robot that stopped for a minute.
        senders.take(
            Stream::WheelOdometry,
            RobotTime(START_NS + 70_000 * MS),
            1,
            None,
        );
        assert_eq!(senders.missing(Stream::WheelOdometry), 0);
    }

    #[test]
    fn there_is_one_again_when_the_second_has_gone() {
        let mut senders = Senders::default();
        for number in 0..40 {
            for clock in [0, 500] {
                senders.take(
                    Stream::WheelOdometry,
                    RobotTime(START_NS + (number * 10 + clock) * MS),
                    number as u64,
                    None,
                );
            }
        }
        assert!(senders.are_two());
        for number in 100..600 {
            senders.take(
                Stream::WheelOdometry,
                RobotTime(START_NS + number * 10 * MS),
                number as u64,
                None,
            );
        }
        assert!(!senders.are_two());
    }
}
