//! The recent drive samples of a robot, cut to any interval of drive time.

use std::collections::{BTreeMap, VecDeque};

use nalgebra::{Matrix3, Vector3};

use crate::stream::{DriveSample, RobotTime};
use crate::vehicle::{DriveReading, SteeringResponse};

/// Time from its predecessor beyond which a drive sample does not describe the time between, s.
pub const GAP_MIN_S: f64 = 0.5;

/// Difference within which readings are the same code of an encoder, rad.
const SAME_READING_RAD: f64 = 1e-6;
/// Largest step of a steering encoder that is believed, rad (2 degrees).
const ENCODER_STEP_MAX_RAD: f64 = 0.035;
/// Way beyond which a constant reading is no trembling wheel's, m.
const HELD_LONG_M: f64 = 0.5;
/// Angle from its zero within which steering shows where that is, rad.
const ALMOST_STRAIGHT_RAD: f64 = 0.1;
/// Two points with mean 0, variance 1 and the skewness 2 of a first-order lag: `-LATE` with the weight
/// `LATE_SHARE = (2 - sqrt 2) / 4`, and `EARLY`.
const LATE_SHARE: f64 = 0.146_446_609_406_726_24;
const LATE: f64 = 1.0 + std::f64::consts::SQRT_2;
const EARLY: f64 = std::f64::consts::SQRT_2 - 1.0;
/// Half of the play that is assumed to find the side of it that the steering is on, rad: typical,
/// and more than an encoder trembles.
const HALF_PLAY_RAD: f64 = 0.005;
/// Departure of the steering from its parabola that is a jump, rad: a wheel that begins to turn at
/// 1 rad/s departs by a quarter of it,
const JUMP_RAD: f64 = 0.05;
/// unless its samples are that noisy: so many mean differences between neighbours, 4.5 sigmas of white noise.
const JUMP_NOISES: f64 = 4.0;
/// Time before and after within which samples give speed and steering without noise, and their
/// changes, s,
const PARABOLA_REACH_S: f64 = 0.12;
/// and fewest of these samples.
const PARABOLA_SAMPLES_MIN: f64 = 4.0;
/// Number of the newest samples with which the search for one begins: a quarter of a second at 100
/// Hz.
const SEARCH_STEP: usize = 24;

/// Recent drive samples, oldest first. A sample describes the interval that ends at its stamp.
#[derive(Debug, Clone)]
pub struct DriveHistory {
    samples: VecDeque<Kept>,
    span_s: f64,
    /// Smallest change between two steering readings so far: the step of a quantised encoder.
    smallest_change_rad: f64,
    /// Number of the samples whose reading has stayed for long.
    held_long: usize,
}

/// A sample and the way on its steering reading before it.
#[derive(Debug, Clone, Copy)]
struct Kept {
    sample: DriveSample,
    held_m: f64,
    /// Angle of the wheel behind that play, rad.
    behind_play_rad: f64,
}

impl Kept {
    fn is_held_long(&self) -> bool {
        self.held_m > HELD_LONG_M
    }
}

/// A stretch of drive time with one reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveSegment {
    /// Its length, s.
    pub duration_s: f64,
    /// The reading that holds over it.
    pub drive: DriveReading,
    /// Distance already driven on this very steering reading, m.
    pub held_m: f64,
    /// Step of the steering encoder, rad; 0 when it is too fine to see.
    pub steering_step_rad: f64,
}

impl DriveHistory {
    /// A history that reaches `span_s` seconds back.
    pub fn new(span_s: f64) -> Self {
        Self {
            samples: VecDeque::new(),
            span_s,
            smallest_change_rad: f64::INFINITY,
            held_long: 0,
        }
    }

    /// Adds a sample, newer than all before, and drops those beyond the span.
    pub fn push(&mut self, sample: DriveSample) {
        let (mut held_m, mut behind_play_rad) = (0.0, sample.steering_rad());
        if let Some(Kept {
            sample: last,
            held_m: before_m,
            behind_play_rad: before_rad,
        }) = self.samples.back()
        {
            let change_rad = (sample.steering_rad() - last.steering_rad()).abs();
            behind_play_rad = before_rad.clamp(
                sample.steering_rad() - HALF_PLAY_RAD,
                sample.steering_rad() + HALF_PLAY_RAD,
            );
            let interval_s = sample.stamp().seconds_since(last.stamp());
            if change_rad < SAME_READING_RAD {
                held_m = before_m + last.speed_mps().abs() * interval_s.min(GAP_MIN_S);
            } else {
                self.smallest_change_rad = self.smallest_change_rad.min(change_rad);
            }
        }
        let kept = Kept {
            sample,
            held_m,
            behind_play_rad,
        };
        self.held_long += usize::from(kept.is_held_long());
        self.samples.push_back(kept);
        while let Some(oldest) = self.samples.front()
            && sample.stamp().seconds_since(oldest.sample.stamp()) > self.span_s
        {
            self.held_long -= usize::from(oldest.is_held_long());
            self.samples.pop_front();
        }
    }

    /// Step of the steering encoder, rad; 0 while none is seen.
    pub fn steering_step_rad(&self) -> f64 {
        if self.smallest_change_rad <= ENCODER_STEP_MAX_RAD {
            self.smallest_change_rad
        } else {
            0.0
        }
    }

    /// Variance of the steering's zero that no driving removes, rad^2: a reading that stays for
    /// longer than a trembling wheel's errs by one number, up to half a step, wherever it comes
    /// back. With the shares `w` of the recent way almost straight ahead that were driven on each
    /// such reading, it is `step^2 / 12` times the sum of `w^2`.
    pub fn repeated_reading_variance_rad2(&self, straight_rad: f64) -> f64 {
        let step_rad = self.steering_step_rad();
        if step_rad <= 0.0 || self.held_long == 0 {
            return 0.0;
        }
        let mut ways_m: BTreeMap<i64, f64> = BTreeMap::new();
        let mut all_m = 0.0;
        let mut before: Option<RobotTime> = None;
        for kept in &self.samples {
            let sample = kept.sample;
            let interval_s = before.map_or(0.0, |before| sample.stamp().seconds_since(before));
            before = Some(sample.stamp());
            if (sample.steering_rad() - straight_rad).abs() > ALMOST_STRAIGHT_RAD {
                continue;
            }
            let way_m = sample.speed_mps().abs() * interval_s.min(GAP_MIN_S);
            all_m += way_m;
            if kept.is_held_long() {
                let reading = (sample.steering_rad() / step_rad).round() as i64;
                *ways_m.entry(reading).or_default() += way_m;
            }
        }
        let squares_m2: f64 = ways_m.values().map(|way_m| way_m * way_m).sum();
        step_rad.powi(2) / 12.0 * squares_m2 / (all_m * all_m).max(f64::MIN_POSITIVE)
    }

    /// Forgets everything: a new session begins.
    pub fn clear(&mut self) {
        self.samples.clear();
        self.held_long = 0;
    }

    /// The oldest sample that is kept.
    pub fn oldest(&self) -> Option<DriveSample> {
        self.samples.front().map(|kept| kept.sample)
    }

    /// Time of the newest sample.
    pub fn newest(&self) -> Option<RobotTime> {
        self.samples.back().map(|kept| kept.sample.stamp())
    }

    /// The newest reading.
    pub fn now(&self) -> DriveReading {
        self.samples
            .back()
            .map_or_else(DriveReading::default, reading)
    }

    /// The reading that describes a time, for a wheel that follows its sensor so; rest when there is
    /// none.
    pub fn at(&self, stamp: RobotTime, response: SteeringResponse) -> DriveReading {
        let index = self.first_at(stamp);
        self.samples
            .get(index)
            .map_or_else(DriveReading::default, |kept| {
                self.reading_followed(kept, stamp, response)
            })
    }

    /// A sample with the steering as a wheel follows it: the weighed mean of two angles that were measured
    /// before and after its lag, which has the lag and the spread of its response.
    fn reading_followed(
        &self,
        kept: &Kept,
        at: RobotTime,
        response: SteeringResponse,
    ) -> DriveReading {
        let SteeringResponse { lag_s, spread_s2 } = response;
        let stamp = kept.sample.stamp().plus_seconds(-lag_s);
        let at_rad = |by_s: f64| self.steering_at_rad(stamp.plus_seconds(by_s), kept);
        let spread_s = spread_s2.max(0.0).sqrt();
        let turned = at.plus_seconds(-lag_s);
        let angle = self.parabola(turned, DriveSample::steering_rad);
        let speed = self.parabola(at, DriveSample::speed_mps);
        DriveReading {
            speed_rate_mps2: speed.map_or(0.0, |speed| speed.y),
            steering_rad: at_rad(-LATE * spread_s) * LATE_SHARE
                + at_rad(EARLY * spread_s) * (1.0 - LATE_SHARE),
            steering_rate_radps: angle.map_or(0.0, |angle| angle.y),
            steering_acceleration_radps2: angle.map_or(0.0, |angle| angle.z),
            play_side: self.play_side_at(stamp, kept),
            response,
            smoothed: speed.zip(angle).map(|(speed, angle)| [speed.x, angle.x]),
            ..reading(kept)
        }
    }

    /// True if the steering jumps around a time, where no parabola describes it: how a wheel
    /// follows a jump is not known to second order in time, and a first order would pass for
    /// knowledge of it.
    pub fn jumps_at(&self, stamp: RobotTime, response: SteeringResponse) -> bool {
        let Some(kept) = self.samples.get(self.first_at(stamp)) else {
            return false;
        };
        let stamp = kept.sample.stamp();
        let turned = stamp.plus_seconds(-response.lag_s);
        self.leaves_parabola_at(stamp) || self.leaves_parabola_at(turned)
    }

    fn leaves_parabola_at(&self, stamp: RobotTime) -> bool {
        let Some(fitted) = self.parabola(stamp, DriveSample::steering_rad) else {
            return false;
        };
        let first = self.first_at(stamp.plus_seconds(-PARABOLA_REACH_S));
        let last = stamp.plus_seconds(PARABOLA_REACH_S);
        let (mut departs_rad, mut largest_rad, mut sum_rad, mut count) =
            (0.0_f64, 0.0_f64, 0.0, 0.0);
        let mut before_rad = None;
        let around = self.samples.range(first..).map(|kept| kept.sample);
        for sample in around.take_while(|sample| sample.stamp() <= last) {
            let (t_s, steering_rad) = (sample.stamp().seconds_since(stamp), sample.steering_rad());
            let parabola_rad = fitted.x + fitted.y * t_s + 0.5 * fitted.z * t_s * t_s;
            departs_rad = departs_rad.max((steering_rad - parabola_rad).abs());
            let change_rad = (steering_rad - before_rad.unwrap_or(steering_rad)).abs();
            largest_rad = largest_rad.max(change_rad);
            sum_rad += change_rad;
            count += 1.0;
            before_rad = Some(steering_rad);
        }
        // All changes but the largest tell the noise of the samples.
        let noise_rad = (sum_rad - largest_rad) / (count - 2.0);
        departs_rad > JUMP_RAD.max(JUMP_NOISES * noise_rad)
    }

    /// Index of the first sample from a time on.
    fn first_at(&self, stamp: RobotTime) -> usize {
        let is_before = |index: usize| {
            let kept = self.samples.get(index);
            kept.is_some_and(|kept| kept.sample.stamp() < stamp)
        };
        // What is asked for is recent: from the newest back in ever longer steps, then halving the last one.
        let (mut low, mut high) = (self.samples.len(), self.samples.len());
        let mut step = SEARCH_STEP;
        while low > 0 {
            high = low;
            low = low.saturating_sub(step);
            if is_before(low) {
                break;
            }
            step *= 2;
        }
        while low < high {
            let middle = low.midpoint(high);
            if is_before(middle) {
                low = middle + 1;
            } else {
                high = middle;
            }
        }
        low
    }

    /// Side of a typical play that the steering is on at a time, from -1 to 1.
    fn play_side_at(&self, stamp: RobotTime, kept: &Kept) -> f64 {
        let index = self.first_at(stamp);
        let there = self.samples.get(index).unwrap_or(kept);
        (there.sample.steering_rad() - there.behind_play_rad) / HALF_PLAY_RAD
    }

    /// Value, first and second derivative (by s and s^2) of a reading at a time: those of the parabola through
    /// the samples around it. `None` where they are too few. The noise of single readings would pass for
    /// knowledge of how the wheel follows its sensor.
    fn parabola(&self, stamp: RobotTime, of: impl Fn(&DriveSample) -> f64) -> Option<Vector3<f64>> {
        let from = stamp.plus_seconds(-PARABOLA_REACH_S);
        let first = self.first_at(from);
        let first_value = of(&self.samples.get(first)?.sample);
        // Sums of the powers of u, and of the values times them.
        let [mut n, mut u1, mut u2, mut u3, mut u4] = [0.0; 5];
        let mut right = Vector3::zeros();
        for Kept { sample, .. } in self.samples.range(first..) {
            // In units of the reach, and from the first value, which keeps the numbers near one.
            let u = sample.stamp().seconds_since(stamp) * (1.0 / PARABOLA_REACH_S);
            if u > 1.0 {
                break;
            }
            let (square, value) = (u * u, of(sample) - first_value);
            n += 1.0;
            u1 += u;
            u2 += square;
            u3 += square * u;
            u4 += square * square;
            right += Vector3::new(value, u * value, square * value);
        }
        if n < PARABOLA_SAMPLES_MIN {
            return None;
        }
        let normal = Matrix3::new(n, u1, u2, u1, u2, u3, u2, u3, u4);
        let fitted = normal.cholesky()?.solve(&right);
        Some(Vector3::new(
            first_value + fitted.x,
            fitted.y / PARABOLA_REACH_S,
            2.0 * fitted.z / PARABOLA_REACH_S.powi(2),
        ))
    }

    /// The measured steering angle at a time, rad, between samples in proportion; beyond them that of the
    /// outermost.
    fn steering_at_rad(&self, stamp: RobotTime, kept: &Kept) -> f64 {
        let index = self.first_at(stamp);
        let before = index.checked_sub(1).and_then(|i| self.samples.get(i));
        match (before, self.samples.get(index)) {
            (Some(Kept { sample: from, .. }), Some(Kept { sample: to, .. })) => {
                let over_s = to.stamp().seconds_since(from.stamp());
                let share = stamp.seconds_since(from.stamp()) / over_s;
                from.steering_rad() + share * (to.steering_rad() - from.steering_rad())
            }
            (Some(only), None) | (None, Some(only)) => only.sample.steering_rad(),
            (None, None) => kept.sample.steering_rad(),
        }
    }

    /// True if the interval lies inside the history, without a gap.
    pub fn covers(&self, from: RobotTime, to: RobotTime) -> bool {
        let first = self
            .samples
            .partition_point(|kept| kept.sample.stamp() <= from);
        let Some(before) = first.checked_sub(1).and_then(|i| self.samples.get(i)) else {
            return false;
        };
        let mut previous = before.sample.stamp();
        for Kept { sample, .. } in self.samples.range(first..) {
            if sample.stamp().seconds_since(previous) > GAP_MIN_S {
                return false;
            }
            previous = sample.stamp();
            if previous >= to {
                return true;
            }
        }
        previous >= to
    }

    /// Way of the wheels over `(from, to]`, m, counted without sign.
    pub fn driven_m(&self, from: RobotTime, to: RobotTime) -> f64 {
        let first = self
            .samples
            .partition_point(|kept| kept.sample.stamp() <= from);
        let (mut begin, mut driven_m) = (from, 0.0);
        for Kept { sample, .. } in self.samples.range(first..) {
            let end = sample.stamp().min(to);
            driven_m += sample.speed_mps().abs() * end.seconds_since(begin);
            if end == to {
                break;
            }
            begin = end;
        }
        driven_m
    }

    /// The readings over `(from, to]`, cut at both ends, for a wheel that follows its sensor so.
    /// Covers the part that the history covers. Their rates are differences, which add up to the
    /// change over them.
    pub fn segments(
        &self,
        from: RobotTime,
        to: RobotTime,
        response: SteeringResponse,
    ) -> impl Iterator<Item = DriveSegment> + '_ {
        let first = self
            .samples
            .partition_point(|kept| kept.sample.stamp() <= from);
        let mut begin = from;
        let mut done = from >= to;
        let mut before = self.at(from, response);
        let steering_step_rad = self.steering_step_rad();
        self.samples.range(first..).map_while(move |kept| {
            if done {
                return None;
            }
            let stamp = kept.sample.stamp();
            let end = stamp.min(to);
            done = stamp >= to;
            let duration_s = end.seconds_since(begin);
            begin = end;
            let mut drive = self.reading_followed(kept, end, response);
            if duration_s > 0.0 {
                let (begin, end) = without_noise(before, drive);
                drive.speed_rate_mps2 = (end.speed_mps - begin.speed_mps) / duration_s;
                drive.steering_rate_radps = (end.steering_rad - begin.steering_rad) / duration_s;
            }
            before = drive;
            Some(DriveSegment {
                duration_s,
                drive,
                held_m: kept.held_m,
                steering_step_rad,
            })
        })
    }
}

/// Two readings without the noise of single ones, where that is known of both.
fn without_noise(begin: DriveReading, end: DriveReading) -> (DriveReading, DriveReading) {
    let both = begin.without_noise().zip(end.without_noise());
    both.unwrap_or((begin, end))
}

fn reading(kept: &Kept) -> DriveReading {
    DriveReading {
        speed_mps: kept.sample.speed_mps(),
        steering_rad: kept.sample.steering_rad(),
        ..DriveReading::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamp(ms: i64) -> RobotTime {
        RobotTime(1_000_000_000 + ms * 1_000_000)
    }

    fn history(stamps_ms: &[i64]) -> DriveHistory {
        let mut history = DriveHistory::new(10.0);
        for &ms in stamps_ms {
            history.push(DriveSample::new(stamp(ms), ms as f64 / 1000.0, 0.0).unwrap());
        }
        history
    }

    #[test]
    fn segments_are_cut_at_both_ends_and_carry_the_reading_that_ends_later() {
        let history = history(&[0, 10, 20, 30]);
        let got: Vec<_> = history
            .segments(stamp(5), stamp(25), SteeringResponse::default())
            .map(|s| ((s.duration_s * 1e3).round() as i64, s.drive.speed_mps))
            .collect();
        assert_eq!(got, [(5, 0.010), (10, 0.020), (5, 0.030)]);
    }

    #[test]
    fn a_gap_is_not_covered() {
        let history = history(&[0, 10, 700, 710]);
        assert!(history.covers(stamp(0), stamp(10)));
        assert!(!history.covers(stamp(5), stamp(700)));
        assert!(history.covers(stamp(700), stamp(705)));
        assert!(!history.covers(stamp(700), stamp(720)), "not there yet");
        assert!(
            !history.covers(stamp(-5), stamp(5)),
            "before the first sample"
        );
    }

    #[test]
    fn a_sample_is_found_however_many_there_are() {
        for count in [0_i64, 1, 23, 24, 25, 72, 1_000] {
            let stamps: Vec<i64> = (0..count).map(|i| 7 * i).collect();
            let history = history(&stamps);
            for ms in -3..7 * count + 3 {
                let expected = stamps.iter().filter(|&&at| at < ms).count();
                assert_eq!(history.first_at(stamp(ms)), expected, "{ms} of {count}");
            }
        }
    }

    #[test]
    fn readings_that_stay_for_long_are_counted_while_they_are_kept() {
        let (mut history, mut most) = (DriveHistory::new(2.0), 0);
        for i in 0..1_000_i64 {
            // A new reading every 1.5 s at 1 m/s, and after 5 s one for each sample.
            let reading = if i < 500 { i / 150 } else { i };
            let sample = DriveSample::new(stamp(10 * i), 1.0, reading as f64 * 1e-3).unwrap();
            history.push(sample);
            let kept = history.samples.iter();
            let long = kept.filter(|kept| kept.held_m > HELD_LONG_M).count();
            assert_eq!(history.held_long, long, "after {i} samples");
            most = most.max(long);
        }
        assert!(most > 50, "{most}");
        assert_eq!(history.held_long, 0, "all have left the history");
    }

    #[test]
    fn the_oldest_samples_go() {
        let stamps: Vec<i64> = (0..2000).map(|i| i * 10).collect();
        let history = history(&stamps);
        assert!(history.samples.len() <= 1001);
    }
}
