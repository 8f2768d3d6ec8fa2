//! The recent drive samples of a robot, cut to any interval of drive time.

use std::collections::VecDeque;

use crate::stream::{DriveSample, Stamp};
use crate::vehicle::Drive;

/// A drive sample further from its predecessor than this does not describe the time between, s.
pub const GAP_MIN_S: f64 = 0.5;

/// Recent drive samples, oldest first. A sample describes the interval that ends at its stamp.
#[derive(Debug, Clone)]
pub struct DriveHistory {
    samples: VecDeque<DriveSample>,
    span_s: f64,
}

/// A stretch of drive time with one reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveSegment {
    /// Its length, s.
    pub duration_s: f64,
    /// The reading that holds over it.
    pub drive: Drive,
}

impl DriveHistory {
    /// A history that reaches `span_s` seconds back.
    pub fn new(span_s: f64) -> Self {
        Self {
            samples: VecDeque::new(),
            span_s,
        }
    }

    /// Adds a sample, newer than all before, and lets go of those beyond the span.
    pub fn push(&mut self, sample: DriveSample) {
        self.samples.push_back(sample);
        while let Some(oldest) = self.samples.front()
            && sample.stamp().seconds_since(oldest.stamp()) > self.span_s
        {
            self.samples.pop_front();
        }
    }

    /// Forgets everything: a new session begins.
    pub fn clear(&mut self) {
        self.samples.clear();
    }

    /// Stamp of the newest sample.
    pub fn newest(&self) -> Option<Stamp> {
        self.samples.back().map(DriveSample::stamp)
    }

    /// The newest reading.
    pub fn now(&self) -> Drive {
        self.samples.back().map_or_else(Drive::default, reading)
    }

    /// The reading that describes a time; rest when there is none.
    pub fn at(&self, stamp: Stamp) -> Drive {
        let index = self.samples.partition_point(|s| s.stamp() < stamp);
        self.samples.get(index).map_or_else(Drive::default, reading)
    }

    /// Whether the interval lies inside the history, without a gap.
    pub fn covers(&self, from: Stamp, to: Stamp) -> bool {
        let first = self.samples.partition_point(|s| s.stamp() <= from);
        let Some(before) = first.checked_sub(1).and_then(|i| self.samples.get(i)) else {
            return false;
        };
        let mut previous = before.stamp();
        for sample in self.samples.range(first..) {
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
    pub fn segments(&self, from: Stamp, to: Stamp) -> impl Iterator<Item = DriveSegment> + '_ {
        let first = self.samples.partition_point(|s| s.stamp() <= from);
        let mut begin = from;
        let mut done = from >= to;
        self.samples.range(first..).map_while(move |sample| {
            if done {
                return None;
            }
            let end = sample.stamp().min(to);
            done = sample.stamp() >= to;
            let duration_s = end.seconds_since(begin);
            begin = end;
            Some(DriveSegment {
                duration_s,
                drive: reading(sample),
            })
        })
    }
}

fn reading(sample: &DriveSample) -> Drive {
    Drive {
        speed_mps: sample.speed_mps(),
        steering_rad: sample.steering_rad(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamp(ms: i64) -> Stamp {
        Stamp(1_000_000_000 + ms * 1_000_000)
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
