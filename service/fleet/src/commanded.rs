//! Tells a steering angle that was measured from one that was only commanded.
//!
//! A sensor's angle has noise, or the steps of an encoder, or, where it was smoothed, a lag behind
//! the vehicle. What a path follower commands has none of the three. Fourth differences tell noise
//! from motion: noise of standard deviation σ gives them √70 σ, a smooth curve next to nothing.

use fleetcal_estimator::DriveSample;

/// Speed below which angles are ignored, m/s.
const SPEED_MIN_MPS: f64 = 0.1;
/// Samples in one judged block.
const BLOCK_SAMPLES: usize = 1_000;
/// Fewest different consecutive angles of a block that can be judged.
const DIFFERENT_MIN: usize = 200;
/// Consecutive blocks that have to agree: half a minute of driving at 100 Hz.
const BLOCKS_MIN: u32 = 3;
/// Median fourth difference below which the angles are free of noise, rad: σ of 0.0002 degrees.
const FOURTH_DIFFERENCE_MAX_RAD: f64 = 2e-5;
/// Smallest step of an encoder, rad.
const STEP_MIN_RAD: f64 = 2e-6;
/// Distance from whole steps that an encoder's changes may have, in steps, and the share of changes
/// that keep it.
const STEP_TOLERANCE: f64 = 0.05;
const STEPS_SHARE_MIN: f64 = 0.95;
/// Lag above which an angle counts as measured and smoothed, if significantly exceeded, s.
const LAG_MIN_S: f64 = 0.02;

/// Character of a block of angles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Character {
    /// The angles have noise or an encoder's steps.
    Measured,
    /// The angles are smooth to the last digit.
    Smooth,
    /// The angles change too little to judge.
    Unknown,
}

/// Classifier of a robot's steering angles: measured or commanded.
#[derive(Debug, Default)]
pub struct SteeringWatch {
    /// Different angles of the block, in order of arrival.
    angles: Vec<f64>,
    samples: usize,
    /// Consecutive smooth blocks.
    smooth: u32,
}

impl SteeringWatch {
    /// Adds a drive sample.
    pub fn take(&mut self, sample: &DriveSample) {
        self.take_angle(sample.steering_rad(), sample.speed_mps());
    }

    /// Adds an angle as it was sent, with the robot's speed. Interpolated angles must not be added:
    /// they do not show their source.
    pub fn take_angle(&mut self, angle: f64, speed_mps: f64) {
        if speed_mps.abs() < SPEED_MIN_MPS {
            return;
        }
        self.samples += 1;
        // A value that is sent twice, because it is sampled more slowly, says nothing new.
        let last = self.angles.last();
        if last.is_none_or(|last| (angle - last).abs() > 0.0) {
            self.angles.push(angle);
        }
        if self.samples < BLOCK_SAMPLES {
            return;
        }
        match character(&self.angles) {
            Character::Measured => self.smooth = 0,
            Character::Smooth => self.smooth = self.smooth.saturating_add(1),
            Character::Unknown => {}
        }
        self.samples = 0;
        self.angles.clear();
    }

    /// True if the angles look commanded. `time_offset` is the delay of a motion in the angles
    /// against the LiDAR, and its sigma, s, where it is known.
    pub fn looks_commanded(&self, time_offset: Option<(f64, f64)>) -> bool {
        let lags = time_offset.is_some_and(|(late_s, sigma_s)| late_s - 2.0 * sigma_s > LAG_MIN_S);
        self.smooth >= BLOCKS_MIN && !lags
    }
}

fn character(angles: &[f64]) -> Character {
    if angles.len() < DIFFERENT_MIN {
        return Character::Unknown;
    }
    if has_steps(angles) {
        return Character::Measured;
    }
    let mut fourth: Vec<f64> = angles
        .windows(5)
        .filter_map(|window| match *window {
            [a, b, c, d, e] => Some((a - 4.0 * b + 6.0 * c - 4.0 * d + e).abs()),
            _ => None,
        })
        .collect();
    let middle = fourth.len() / 2;
    if middle == 0 {
        return Character::Unknown;
    }
    let (_, median, _) = fourth.select_nth_unstable_by(middle, f64::total_cmp);
    if *median < FOURTH_DIFFERENCE_MAX_RAD {
        Character::Smooth
    } else {
        Character::Measured
    }
}

/// True if all changes are whole multiples of one step, as those of an encoder are.
fn has_steps(angles: &[f64]) -> bool {
    let changes = || {
        let pairs = angles.windows(2);
        pairs.filter_map(|pair| match *pair {
            [a, b] => Some((b - a).abs()),
            _ => None,
        })
    };
    let step = changes().fold(f64::INFINITY, f64::min);
    if step < STEP_MIN_RAD {
        return false;
    }
    let whole = |change: f64| {
        let steps = change / step;
        (steps - steps.round()).abs() < STEP_TOLERANCE
    };
    let share = changes().filter(|&change| whole(change)).count() as f64 / angles.len() as f64;
    share >= STEPS_SHARE_MIN
}

#[cfg(test)]
mod tests {
    use fleetcal_estimator::RobotTime;

    use super::*;

    /// Samples steering for 60 s at 100 Hz through `sensor`, which receives the time and the true
    /// angle.
    fn watched(mut sensor: impl FnMut(f64, f64) -> f64) -> SteeringWatch {
        let mut watch = SteeringWatch::default();
        for number in 0..6_000_i64 {
            let time_s = number as f64 * 0.01;
            let angle = 0.3 * (0.5 * time_s).sin() + 0.05 * (1.7 * time_s).cos();
            let stamp = RobotTime(1_700_000_000_000_000_000 + number * 10_000_000);
            // What travels is a number of 32 bits.
            let sent = f64::from(sensor(time_s, angle) as f32);
            watch.take(&DriveSample::new(stamp, 1.0, sent).unwrap());
        }
        watch
    }

    /// Returns pseudorandom numbers between -1 and 1.
    fn noise(time_s: f64) -> f64 {
        ((time_s * 12_345.678).sin() * 43_758.545).fract()
    }

    #[test]
    fn a_command_is_told_from_a_measurement() {
        let plain = watched(|_, angle| angle);
        assert!(plain.looks_commanded(None));
        // Commanded at 20 Hz and held.
        let held = watched(|time_s, _| {
            let time_s = (time_s / 0.05 + 1e-6).floor() * 0.05;
            0.3 * (0.5 * time_s).sin()
        });
        assert!(held.looks_commanded(None));
        let noisy = watched(|time_s, angle| angle + 1e-4 * noise(time_s));
        assert!(!noisy.looks_commanded(None));
        for step_deg in [0.25_f64, 0.02] {
            let step = step_deg.to_radians();
            let encoder = watched(|_, angle| (angle / step).round() * step);
            assert!(
                !encoder.looks_commanded(None),
                "steps of {step_deg} degrees"
            );
        }
    }

    #[test]
    fn what_lags_was_measured_and_smoothed() {
        let watch = watched(|_, angle| angle);
        assert!(!watch.looks_commanded(Some((0.08, 0.005))));
        assert!(watch.looks_commanded(Some((-0.08, 0.005))));
        assert!(
            watch.looks_commanded(Some((0.08, 0.05))),
            "not significantly"
        );
    }

    #[test]
    fn a_parked_or_straight_robot_says_nothing() {
        let straight = watched(|_, _| 0.01);
        assert!(!straight.looks_commanded(None));
        let mut parked = SteeringWatch::default();
        for number in 0..6_000_i64 {
            let stamp = RobotTime(1_700_000_000_000_000_000 + number * 10_000_000);
            let angle = number as f64 * 1e-4;
            parked.take(&DriveSample::new(stamp, 0.0, angle).unwrap());
        }
        assert!(!parked.looks_commanded(None));
    }
}
