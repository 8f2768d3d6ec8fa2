//! Stamps of a stream, one after the other, and against the time of arrival.

use fleetcal_model::RobotTime;

use crate::cause::Cause;
use crate::finding::Suspicion;
use crate::fit::quantile;

/// Latest steps and ages that are kept.
const LATEST: usize = 64;
/// Fewest of them that show anything.
const LATEST_MIN: usize = 32;
/// Share of repeated stamps that is no accident.
const REPEATED_MIN: f64 = 0.4;
/// Unevenness of stamps that are made where messages are received, s, and as a share of the period.
const UNEVEN_MIN_S: f64 = 0.04;
const UNEVEN_MIN_SHARE: f64 = 0.05;
/// Unevenness of a stream in which single steps show, as a share of the period.
const EVEN_MAX_SHARE: f64 = 0.1;
/// Distance of a step between stamps from a whole number of periods, as a share, from which it is
/// none of its clock's.
const OFF_SHARE: f64 = 0.3;
/// Share of such steps, and number of them, that is no accident.
const STEPPED_MIN_SHARE: f64 = 0.004;
const STEPPED_MIN: u32 = 5;
/// Parts of a second up to which `nanosec` may hold microseconds, s.
const MICROSECONDS_MAX_S: f64 = 1.1e-3;
/// Age behind the newest stamp from which a stamp is late or of a clock that went back, s.
const BACK_MIN_S: f64 = 0.3;
/// A stamp so far ahead of the newest counts once a second one agrees, s.
const AHEAD_MIN_S: f64 = 60.0;
/// Messages in a row that stay behind where the clock went back.
const BACK_MESSAGES: u32 = 10;
/// A wait that counts as gap, in periods and at least, s.
const GAP_PERIODS: f64 = 5.0;
const GAP_MIN_S: f64 = 0.5;

/// Stamps of one stream.
#[derive(Debug, Clone, Default)]
pub(crate) struct StampWatch {
    newest: Option<RobotTime>,
    last: Option<RobotTime>,
    steps_s: Vec<f32>,
    ages_s: Vec<f64>,
    messages: u32,
    pub repeated: u32,
    pub late: u32,
    pub gaps: u32,
    pub longest_gap_s: f64,
    /// A stamp far ahead of the newest, which nothing confirms yet.
    ahead: Option<RobotTime>,
    /// Messages in a row that are behind the newest.
    behind: u32,
    went_back_s: Option<f64>,
    /// Period and unevenness, s, found once a block.
    even: Option<(f64, f64)>,
    off_steps: u32,
    judged_steps: u32,
    fraction_max_s: f64,
    fractions: u32,
}

impl StampWatch {
    /// Adds the next stamp, and the time of arrival, ns.
    pub fn take(&mut self, stamp: RobotTime, arrival_ns: i64) {
        let place = self.messages as usize % LATEST;
        self.messages = self.messages.saturating_add(1);
        put(
            &mut self.ages_s,
            place,
            arrival_ns.saturating_sub(stamp.0) as f64 * 1e-9,
        );
        self.note_fraction(stamp);
        let newest = *self.newest.get_or_insert(stamp);
        if let Some(last) = self.last.replace(stamp) {
            let step_s = stamp.seconds_since(last);
            self.repeated += u32::from(stamp == last);
            self.late += u32::from(stamp < last);
            self.note_step(step_s);
            put(&mut self.steps_s, place, step_s as f32);
        }
        let behind_s = newest.seconds_since(stamp);
        if -behind_s > AHEAD_MIN_S {
            let before = self.ahead.replace(stamp);
            let agrees = |before: RobotTime| stamp.seconds_since(before).abs() < AHEAD_MIN_S;
            if !before.is_some_and(agrees) {
                return;
            }
        }
        self.ahead = None;
        if behind_s <= BACK_MIN_S {
            self.behind = 0;
            self.newest = Some(stamp.max(newest));
            return;
        }
        self.behind += 1;
        if self.behind >= BACK_MESSAGES {
            self.went_back_s = Some(behind_s);
            (self.newest, self.behind) = (Some(stamp), 0);
        }
    }

    /// Median step between stamps, s; `None` of a stream that is too short.
    pub fn period_s(&self) -> Option<f64> {
        let mut steps: Vec<f64> = self.rising_steps().collect();
        (steps.len() >= LATEST_MIN).then(|| quantile(&mut steps, 0.5))
    }

    /// Returns the median age of the messages at their arrival, s.
    pub fn age_s(&self) -> Option<f64> {
        (!self.ages_s.is_empty()).then(|| quantile(&mut self.ages_s.clone(), 0.5))
    }

    /// Period of the stamps, s, and how far steps are off a whole number of periods, the upper fifth, s.
    /// Where messages are missing as often as not, the period is that of the shorter steps.
    fn evenness_s(&self) -> Option<(f64, f64)> {
        let mut steps: Vec<f64> = self.rising_steps().collect();
        if steps.len() < LATEST_MIN {
            return None;
        }
        let (shorter_s, median_s) = (quantile(&mut steps, 0.25), quantile(&mut steps, 0.5));
        let uneven_s = |period_s: f64| {
            let off =
                |step_s: f64| (step_s - period_s * (step_s / period_s).round().max(1.0)).abs();
            quantile(&mut self.rising_steps().map(off).collect::<Vec<_>>(), 0.8)
        };
        let of_shorter_s = uneven_s(shorter_s);
        if of_shorter_s < EVEN_MAX_SHARE * shorter_s {
            return Some((shorter_s, of_shorter_s));
        }
        Some((median_s, uneven_s(median_s)))
    }

    /// Returns the distance of steps between stamps from a whole number of periods: four in five are nearer, s.
    pub fn unevenness_s(&self) -> Option<f64> {
        self.evenness_s().map(|(_, uneven_s)| uneven_s)
    }

    /// Returns the suspicions from the stamps.
    pub fn suspicions(&self, name: &str) -> Vec<Suspicion> {
        let mut found = Vec::new();
        if let Some(back_s) = self.went_back_s {
            let seen = format!("the stamps of {name} went back by {back_s:.2} s");
            found.push(Suspicion::new(Cause::ClockBack, seen));
        }
        if (self.messages as usize) < LATEST_MIN {
            return found;
        }
        let standing = self.steps_s.iter().filter(|step| step.abs() < 1e-9).count();
        let share = standing as f64 / self.steps_s.len() as f64;
        let (period_s, uneven_s) = self.evenness_s().unwrap_or((f64::INFINITY, 0.0));
        if share > REPEATED_MIN {
            let share = 100.0 * share;
            let seen = format!("{share:.0} % of {name} are stamped as the one before");
            found.push(Suspicion::new(Cause::RepeatedStamps, seen));
        } else if self.fractions > 1 && self.fraction_max_s < MICROSECONDS_MAX_S && period_s < 0.9 {
            let seen = format!("no stamp of {name} is more than 1.1 ms after a whole second");
            found.push(Suspicion::new(Cause::NanosecondField, seen));
        } else if uneven_s > UNEVEN_MIN_S && uneven_s > UNEVEN_MIN_SHARE * period_s {
            let seen = format!(
                "the stamps of {name} are {:.0} ms apart, give or take {:.0} ms",
                1e3 * period_s,
                1e3 * uneven_s
            );
            found.push(Suspicion::new(Cause::ReceptionStamps, seen));
        } else if self.off_steps >= STEPPED_MIN
            && f64::from(self.off_steps) > STEPPED_MIN_SHARE * f64::from(self.judged_steps)
        {
            let seen = format!(
                "{} of {} steps between stamps of {name} are no multiple of {:.0} ms",
                self.off_steps,
                self.judged_steps,
                1e3 * period_s
            );
            found.push(Suspicion::new(Cause::SteppedClock, seen));
        }
        found
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        self.steps_s.capacity() * size_of::<f32>() + self.ages_s.capacity() * size_of::<f64>()
    }

    fn rising_steps(&self) -> impl Iterator<Item = f64> {
        let rising = self.steps_s.iter().filter(|step| **step > 0.0);
        rising.map(|step| f64::from(*step))
    }

    fn note_fraction(&mut self, stamp: RobotTime) {
        let fraction_s = stamp.0.rem_euclid(1_000_000_000) as f64 * 1e-9;
        self.fractions += u32::from(fraction_s > 0.0);
        self.fraction_max_s = self.fraction_max_s.max(fraction_s);
    }

    /// Judges a step by the period of those before.
    fn note_step(&mut self, step_s: f64) {
        if step_s <= 0.0 {
            return;
        }
        if (self.messages as usize).is_multiple_of(LATEST_MIN) {
            self.even = self.evenness_s();
        }
        let Some((period_s, uneven_s)) = self.even else {
            return;
        };
        if step_s > (GAP_PERIODS * period_s).max(GAP_MIN_S) {
            self.gaps += 1;
            self.longest_gap_s = self.longest_gap_s.max(step_s);
        }
        self.judged_steps += 1;
        let periods = step_s / period_s;
        let is_off = (periods - periods.round().max(1.0)).abs() > OFF_SHARE;
        let is_even = uneven_s < EVEN_MAX_SHARE * period_s;
        self.off_steps += u32::from(is_off && is_even && periods < GAP_PERIODS);
    }
}

fn put<T>(ring: &mut Vec<T>, place: usize, value: T) {
    match ring.get_mut(place) {
        Some(old) => *old = value,
        None => ring.push(value),
    }
}

/// Windows of arrival in which the least age of each stream is looked for, s.
const WINDOW_S: f64 = 2.0;
/// Windows on either side of a step.
const SIDE: usize = 5;
/// Least step that is named, s.
const STEP_MIN_S: f64 = 0.025;
/// Smallest step over the spread of the windows on a side.
const STEP_OVER_SPREAD: f64 = 4.0;
/// Largest change of both ages from window to window: beyond it the receiver's clock was stepped, or
/// messages are sent faster or slower than they are stamped, s.
const BOTH_MAX_S: f64 = 0.02;

/// Ages of LiDAR and wheels against each other: a step of one clock shows there, one of the receiver's
/// does not.
#[derive(Debug, Clone, Default)]
pub(crate) struct AgeWatch {
    window_ends_ns: i64,
    least_s: [Option<f64>; 2],
    /// Newest stamp of the wheels.
    wheels: Option<RobotTime>,
    /// Stamps of the wheels at the LiDAR's latest messages less those, s.
    apart_s: Vec<f32>,
    lidar_messages: usize,
    /// Least ages of the windows before, the oldest first.
    windows_s: Vec<[f64; 2]>,
    step: Option<(usize, f64)>,
}

impl AgeWatch {
    /// Adds a message of the LiDAR (0) or the wheels (1).
    pub fn take(&mut self, of: usize, stamp: RobotTime, arrival_ns: i64) {
        let age_s = arrival_ns.saturating_sub(stamp.0) as f64 * 1e-9;
        if arrival_ns >= self.window_ends_ns {
            self.close();
            self.window_ends_ns = arrival_ns.saturating_add((WINDOW_S * 1e9) as i64);
        }
        if let Some(least_s) = self.least_s.get_mut(of) {
            *least_s = Some(least_s.map_or(age_s, |least_s| least_s.min(age_s)));
        }
        if of == 1 {
            self.wheels = Some(stamp);
        } else if let Some(wheels) = self.wheels {
            let apart_s = wheels.seconds_since(stamp) as f32;
            put(&mut self.apart_s, self.lidar_messages % LATEST, apart_s);
            self.lidar_messages += 1;
        }
    }

    /// Returns the stamps of the wheels less those of LiDAR messages that arrive with them, their median, s.
    pub fn apart_s(&self) -> Option<f64> {
        let mut apart_s: Vec<f64> = self.apart_s.iter().map(|apart| f64::from(*apart)).collect();
        (!apart_s.is_empty()).then(|| quantile(&mut apart_s, 0.5))
    }

    fn close(&mut self) {
        let [Some(lidar_s), Some(wheels_s)] = std::mem::take(&mut self.least_s) else {
            self.windows_s.clear();
            return;
        };
        let before = self.windows_s.last().copied();
        if before.is_some_and(|[lidar_before_s, wheels_before_s]| {
            let (lidar_by_s, wheels_by_s) = (lidar_s - lidar_before_s, wheels_s - wheels_before_s);
            lidar_by_s.abs().min(wheels_by_s.abs()) > BOTH_MAX_S && lidar_by_s * wheels_by_s > 0.0
        }) {
            self.windows_s.clear();
        }
        if self.windows_s.len() == 2 * SIDE {
            self.windows_s.remove(0);
        }
        self.windows_s.push([lidar_s, wheels_s]);
        if self.windows_s.len() < 2 * SIDE {
            return;
        }
        let (before, after) = self.windows_s.split_at(SIDE);
        let side = |windows: &[[f64; 2]], value: fn(&[f64; 2]) -> f64| {
            let mut values: Vec<f64> = windows.iter().map(value).collect();
            let (low, high) = (quantile(&mut values, 0.0), quantile(&mut values, 1.0));
            (quantile(&mut values, 0.5), high - low)
        };
        let step = |value| {
            let ((before_s, spread_before_s), (after_s, spread_after_s)) =
                (side(before, value), side(after, value));
            (after_s - before_s, spread_before_s.max(spread_after_s))
        };
        let (between_s, spread_s) = step(|[lidar_s, wheels_s]| lidar_s - wheels_s);
        if between_s.abs() < STEP_MIN_S.max(STEP_OVER_SPREAD * spread_s) {
            return;
        }
        let (lidar_step_s, _) = step(|ages| ages[0]);
        let (wheels_step_s, _) = step(|ages| ages[1]);
        self.step = Some(if lidar_step_s.abs() > wheels_step_s.abs() {
            (0, -lidar_step_s)
        } else {
            (1, -wheels_step_s)
        });
    }

    /// Suspicion of a step: of the LiDAR (0) or the wheels (1), forward positive, s.
    pub fn suspicion(&self) -> Option<Suspicion> {
        let (of, step_s) = self.step?;
        let name = if of == 0 { "the LiDAR" } else { "the wheels" };
        let seen = format!(
            "the clock of {name} stepped by {:+.0} ms against the other",
            1e3 * step_s
        );
        Some(Suspicion::new(Cause::SteppedClock, seen))
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        self.windows_s.capacity() * size_of::<[f64; 2]>()
            + self.apart_s.capacity() * size_of::<f32>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Causes of 600 stamps, s.
    fn causes(stamp_s: impl Fn(u32) -> f64) -> Vec<Cause> {
        let mut watch = StampWatch::default();
        for number in 0..600 {
            let stamp_ns = (stamp_s(number) * 1e9).round() as i64;
            let arrival_ns = i64::from(number) * 100_000_000;
            watch.take(RobotTime(1_700_000_000_000_000_000 + stamp_ns), arrival_ns);
        }
        watch
            .suspicions("scan")
            .into_iter()
            .map(|of| of.cause)
            .collect()
    }

    #[test]
    fn stamps_that_cannot_be_are_named() {
        let even = |number: u32| 0.1 * f64::from(number);
        let random = |number: u32| {
            (f64::from(number) * 12.9898)
                .sin()
                .mul_add(43_758.545, 1.0)
                .fract()
        };
        assert_eq!(causes(even), []);
        assert_eq!(
            causes(|number| even(number).floor()),
            [Cause::RepeatedStamps]
        );
        let micro = |number: u32| even(number).floor() + 1e-3 * even(number).fract();
        assert_eq!(causes(micro), [Cause::NanosecondField]);
        let uneven = |number: u32| even(number) + 0.16 * random(number).abs();
        assert_eq!(causes(uneven), [Cause::ReceptionStamps]);
        let stepped = |number: u32| even(number) - 0.05 * f64::from(number % 20) / 20.0;
        assert_eq!(causes(stepped), [Cause::SteppedClock]);
        let back = |number: u32| even(number) - if number > 300 { 2.0 } else { 0.0 };
        assert_eq!(causes(back), [Cause::ClockBack]);
    }

    #[test]
    fn what_a_network_or_a_scheduler_does_is_not_named() {
        // Two of three messages come; a tick of 10 ms stamps a cycle of 15 ms; one in 200 is late.
        assert_eq!(causes(|number| 0.1 * f64::from(number + number / 2)), []);
        assert_eq!(
            causes(|number| 0.01 * (1.5 * f64::from(number)).floor()),
            []
        );
        assert_eq!(
            causes(|number| 0.1 * f64::from(number) - if number % 200 == 7 { 0.15 } else { 0.0 }),
            []
        );
        // One stamp is an hour ahead; a robot was off for an hour.
        let wild = |number: u32| if number == 300 { 3_600.0 } else { 0.0 };
        assert_eq!(causes(|number| 0.1 * f64::from(number) + wild(number)), []);
        let off = |number: u32| if number > 300 { 3_600.0 } else { 0.0 };
        assert_eq!(causes(|number| 0.1 * f64::from(number) + off(number)), []);
    }

    #[test]
    fn a_step_of_one_clock_is_told_from_one_of_the_receivers() {
        let step_of = |lidar_s: f64, wheels_s: f64, receiver_s: f64| {
            let mut watch = AgeWatch::default();
            for number in 0..3_000_i64 {
                let time_s = number as f64 * 0.02;
                let stepped = |by_s: f64| if time_s > 30.0 { by_s } else { 0.0 };
                let arrival_ns = ((time_s + stepped(receiver_s)) * 1e9) as i64;
                let stamp = |by_s: f64| RobotTime(((time_s + stepped(by_s)) * 1e9) as i64);
                watch.take(1, stamp(wheels_s), arrival_ns);
                if number % 5 == 0 {
                    watch.take(0, stamp(lidar_s), arrival_ns);
                }
            }
            watch.step
        };
        assert_eq!(step_of(0.0, 0.0, 0.0), None);
        assert_eq!(step_of(0.0, 0.0, 0.2), None);
        let (of, step_s) = step_of(0.03, 0.0, 0.0).unwrap();
        assert!(of == 0 && (step_s - 0.03).abs() < 1e-6, "{of} {step_s}");
        let (of, step_s) = step_of(0.0, -0.3, 0.0).unwrap();
        assert!(of == 1 && (step_s + 0.3).abs() < 1e-6, "{of} {step_s}");
    }

    #[test]
    fn streams_that_are_sent_ten_times_as_fast_are_not_apart() {
        let mut watch = AgeWatch::default();
        for number in 0..30_000_i64 {
            let time_s = number as f64 * 0.02;
            // Now and then the sender pauses.
            let late_s = 0.013 * f64::from((number / 700 % 3) as u32);
            let arrival_ns = ((0.1 * time_s + late_s) * 1e9) as i64;
            let stamp = RobotTime((time_s * 1e9) as i64);
            watch.take(1, stamp, arrival_ns);
            if number % 5 == 0 {
                watch.take(0, stamp, arrival_ns);
            }
        }
        assert_eq!(watch.step, None);
        assert!(watch.apart_s().unwrap().abs() < 0.03);
    }
}
