//! The recent drive samples of a robot, cut to any interval of drive time.

use std::collections::VecDeque;

use crate::stream::{DriveSample, RobotTime};
use crate::vehicle::DriveReading;

/// A drive sample further from its predecessor than this does not describe the time between, s.
pub const GAP_MIN_S: f64 = 0.5;

/// Readings closer than this are the same code of an encoder, rad.
const SAME_READING_RAD: f64 = 1e-6;
/// Largest step of a steering encoder that is believed, rad (2 degrees).
const ENCODER_STEP_MAX_RAD: f64 = 0.035;

/// Recent drive samples, oldest first. A sample describes the interval that ends at its stamp.
#[derive(Debug, Clone)]
pub struct DriveHistory {
    samples: VecDeque<Kept>,
    span_s: f64,
    /// Smallest change between two steering readings so far: the step of a quantised encoder.
    smallest_change_rad: f64,
}

/// A sample and how far the vehicle had driven on its steering reading before it.
#[derive(Debug, Clone, Copy)]
struct Kept {
    sample: DriveSample,
    held_m: f64,
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
        }
    }

    /// Adds a sample, newer than all before, and lets go of those beyond the span.
    pub fn push(&mut self, sample: DriveSample) {
        let mut held_m = 0.0;
        if let Some(Kept {
            sample: last,
            held_m: before_m,
        }) = self.samples.back()
        {
            let change_rad = (sample.steering_rad() - last.steering_rad()).abs();
            let interval_s = sample.stamp().seconds_since(last.stamp());
            if change_rad < SAME_READING_RAD {
                held_m = before_m + last.speed_mps().abs() * interval_s.min(GAP_MIN_S);
            } else {
                self.smallest_change_rad = self.smallest_change_rad.min(change_rad);
            }
        }
        self.samples.push_back(Kept { sample, held_m });
        while let Some(oldest) = self.samples.front()
            && sample.stamp().seconds_since(oldest.sample.stamp()) > self.span_s
        {
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

    /// Forgets everything: a new session begins.
    pub fn clear(&mut self) {
        self.samples.clear();
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

    /// The reading that describes a time; rest when there is none.
    pub fn at(&self, stamp: RobotTime) -> DriveReading {
        let index = self
            .samples
            .partition_point(|kept| kept.sample.stamp() < stamp);
        self.samples
            .get(index)
            .map_or_else(DriveReading::default, reading)
    }

    /// Whether the interval lies inside the history, without a gap.
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

    /// The readings over `(from, to]`, cut at both ends. Covers what the history covers.
    pub fn segments(
        &self,
        from: RobotTime,
        to: RobotTime,
    ) -> impl Iterator<Item = DriveSegment> + '_ {
        let first = self
            .samples
            .partition_point(|kept| kept.sample.stamp() <= from);
        let mut begin = from;
        let mut done = from >= to;
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
            Some(DriveSegment {
                duration_s,
                drive: reading(kept),
                held_m: kept.held_m,
                steering_step_rad,
            })
        })
    }
}

fn reading(kept: &Kept) -> DriveReading {
    DriveReading {
        speed_mps: kept.sample.speed_mps(),
        steering_rad: kept.sample.steering_rad(),
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
            .segments(stamp(5), stamp(25))
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
    fn the_oldest_samples_go() {
        let stamps: Vec<i64> = (0..2000).map(|i| i * 10).collect();
        let history = history(&stamps);
        assert!(history.samples.len() <= 1001);
    }
}
