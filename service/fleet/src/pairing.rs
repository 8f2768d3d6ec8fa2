//! Steering and speed of different topics, paired by stamp.
//!
//! A drive sample is made for each speed, which describes an interval, with the steering angle
//! interpolated to the speed's stamp. How far the nearest angle was from it is the pairing error.

use std::collections::VecDeque;

use fleetcal_domain::robot::PairingReport;
use fleetcal_estimator::{DriveSample, RobotTime};

use crate::reading::Half;

/// Largest distance of the nearest angle from a speed, s.
const PAIRED_WITHIN_S: f64 = 0.1;
/// Longest wait of a speed for an angle behind it, s of message time: less than the estimator's
/// wait for late streams.
const WAIT_MAX_S: f64 = 0.25;
/// Most speeds, and most angles, that are held at once.
const HELD_MAX: usize = 512;
/// Step back of a stamp that begins a new session, s.
const NEW_SESSION_S: f64 = 5.0;

/// Pairing of steering and speed; see the module.
#[derive(Debug, Default)]
pub struct Pairing {
    steering: VecDeque<Half>,
    speeds: VecDeque<Half>,
    report: PairingReport,
}

impl Pairing {
    /// Adds a steering angle; returns the samples that it completes.
    pub fn take_steering(&mut self, angle: Half) -> Vec<DriveSample> {
        if is_new_session(&self.steering, angle.stamp) {
            self.steering.clear();
            self.speeds.clear();
        }
        insert(&mut self.steering, angle);
        self.complete()
    }

    /// Adds a speed; returns the samples that it completes.
    pub fn take_speed(&mut self, speed: Half) -> Vec<DriveSample> {
        if is_new_session(&self.speeds, speed.stamp) {
            self.steering.clear();
            self.speeds.clear();
        }
        insert(&mut self.speeds, speed);
        self.complete()
    }

    /// Returns the quality of the pairing so far.
    pub fn report(&self) -> PairingReport {
        self.report
    }

    fn complete(&mut self) -> Vec<DriveSample> {
        let mut samples = Vec::new();
        while let Some(&speed) = self.speeds.front() {
            let after = self.steering.iter().position(|of| of.stamp >= speed.stamp);
            let newest = self.speeds.back().map_or(speed.stamp, |of| of.stamp);
            let waited_s = newest.seconds_since(speed.stamp);
            if after.is_none() && waited_s < WAIT_MAX_S && self.speeds.len() < HELD_MAX {
                break;
            }
            self.speeds.pop_front();
            samples.extend(self.sample(speed, after));
        }
        samples
    }

    /// Makes the sample of a speed; `after` is the index of the first angle that is not before it.
    fn sample(&mut self, speed: Half, after: Option<usize>) -> Option<DriveSample> {
        let split = after.unwrap_or(self.steering.len());
        let before = split.checked_sub(1).and_then(|at| self.steering.get(at));
        let after = self.steering.get(split);
        let gap_s = |of: &Half| of.stamp.seconds_since(speed.stamp).abs();
        let near = |of: &&Half| gap_s(of) <= PAIRED_WITHIN_S;
        let angle = match (before.filter(near), after.filter(near)) {
            (Some(before), Some(after)) => {
                let (before_s, after_s) = (gap_s(before), gap_s(after));
                // An angle of the same stamp is taken to the last digit.
                let value = if after_s > 0.0 {
                    let share = before_s / (before_s + after_s);
                    before.value + share * (after.value - before.value)
                } else {
                    after.value
                };
                Some((value, before_s.min(after_s)))
            }
            (Some(only), None) | (None, Some(only)) => Some((only.value, gap_s(only))),
            (None, None) => None,
        };
        // What lies before the last angle used is not asked for again.
        self.steering.drain(..split.saturating_sub(1));
        let Some((angle_rad, error_s)) = angle else {
            self.report.unpaired += 1;
            return None;
        };
        let report = &mut self.report;
        report.paired += 1;
        report.error_mean_s += (error_s - report.error_mean_s) / report.paired as f64;
        report.error_max_s = report.error_max_s.max(error_s);
        DriveSample::new(speed.stamp, speed.value, angle_rad).ok()
    }
}

fn is_new_session(held: &VecDeque<Half>, stamp: RobotTime) -> bool {
    let last = held.back();
    last.is_some_and(|last| stamp.seconds_since(last.stamp) < -NEW_SESSION_S)
}

/// Inserts a half by its stamp; the oldest makes room.
fn insert(held: &mut VecDeque<Half>, half: Half) {
    let later = held.iter().rev().take_while(|of| of.stamp > half.stamp);
    let at = held.len() - later.count();
    held.insert(at, half);
    if held.len() > HELD_MAX {
        held.pop_front();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BEGIN_NS: i64 = 1_700_000_000_000_000_000;

    fn half(milliseconds: i64, value: f64) -> Half {
        Half {
            stamp: RobotTime(BEGIN_NS + milliseconds * 1_000_000),
            value,
        }
    }

    fn stamps_ms(samples: &[DriveSample]) -> Vec<i64> {
        let ms = |sample: &DriveSample| (sample.stamp().0 - BEGIN_NS) / 1_000_000;
        samples.iter().map(ms).collect()
    }

    #[test]
    fn angles_are_interpolated_to_the_speeds() {
        let mut pairing = Pairing::default();
        assert!(pairing.take_speed(half(10, 1.0)).is_empty());
        assert!(pairing.take_steering(half(4, 0.1)).is_empty());
        let samples = pairing.take_steering(half(24, 0.3));
        assert_eq!(stamps_ms(&samples), [10]);
        assert!((samples[0].steering_rad() - 0.16).abs() < 1e-12);
        // One that comes at once when the angle behind it is there already.
        let samples = pairing.take_speed(half(20, 1.0));
        assert!((samples[0].steering_rad() - 0.26).abs() < 1e-12);
        let report = pairing.report();
        assert_eq!((report.paired, report.unpaired), (2, 0));
        assert!((report.error_mean_s - 0.005).abs() < 1e-12, "{report:?}");
        assert!((report.error_max_s - 0.006).abs() < 1e-12, "{report:?}");
    }

    #[test]
    fn a_speed_without_an_angle_is_left_out_and_counted() {
        let mut pairing = Pairing::default();
        pairing.take_steering(half(0, 0.1));
        let mut samples = Vec::new();
        for ms in (0..1_000).step_by(50) {
            samples.extend(pairing.take_speed(half(ms, 1.0)));
        }
        // Those within 0.1 s of the only angle take it once nothing newer came in time.
        assert_eq!(stamps_ms(&samples), [0, 50, 100]);
        let report = pairing.report();
        assert_eq!(report.paired, 3);
        assert!(report.unpaired >= 10, "{report:?}");
        assert!((report.error_max_s - 0.1).abs() < 1e-9);
    }

    #[test]
    fn a_clock_that_jumps_back_begins_anew() {
        let mut pairing = Pairing::default();
        pairing.take_steering(half(60_000, 0.1));
        pairing.take_speed(half(60_010, 1.0));
        pairing.take_speed(half(0, 1.0));
        let samples = pairing.take_steering(half(0, 0.2));
        assert_eq!(stamps_ms(&samples), [0]);
        assert!((samples[0].steering_rad() - 0.2).abs() < 1e-12);
    }

    #[test]
    fn order_within_a_topic_does_not_matter_and_memory_is_bounded() {
        let mut pairing = Pairing::default();
        pairing.take_steering(half(40, 0.4));
        pairing.take_steering(half(20, 0.2));
        let samples = pairing.take_speed(half(30, 1.0));
        assert!((samples[0].steering_rad() - 0.3).abs() < 1e-12);
        for ms in 0..5_000 {
            pairing.take_steering(half(ms, 0.0));
        }
        assert!(pairing.steering.len() <= HELD_MAX);
    }
}
