//! Beam of the fan that a point belongs to, and the time of each beam.

use std::f64::consts::TAU;

use nalgebra::Vector2;

use super::CloudPoint;
use crate::field::FieldRefused;
use crate::geometry::wrap_angle_rad;

/// Most points whose times and directions are evaluated.
const ASKED_MAX: usize = 4096;
/// Largest difference of times that were taken at once, s.
const AT_ONCE_S: f32 = 1e-3;
/// Farthest a point's time may be from the cloud's stamp, s.
const TIME_MAX_S: f32 = 1.0;
/// Least closeness with which directions must follow times (length of the mean of unit vectors).
const FOLLOWS_MIN: f64 = 0.9;
/// Least closeness with which directions must lie on a grid of beams to be its columns.
const COLUMNS_MIN: f64 = 0.5;
/// Largest angle of a point from the scanner's direction, rad; farther aside it is a stray one.
const ASIDE_MAX_RAD: f64 = 0.5;
/// Moments of the turn in the first estimate of the speed.
const MOMENTS: usize = 64;
/// Part of a turn beyond which a point whose time is off its beam's belongs to the next turn.
const SEAM: f64 = 0.25;

/// Fan of beams: its first beam, and the step from one beam to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn {
    /// Beams of the whole turn.
    pub beams: usize,
    /// Direction of the first beam, rad.
    pub first_rad: f64,
    /// Angle from one beam to the next, rad; negative for a scanner that turns clockwise.
    pub increment_rad: f64,
    /// Time of the first beam, s after the cloud's stamp.
    pub first_s: f64,
    /// Time from one beam to the next, s; 0 when all were taken at once.
    pub time_increment_s: f64,
}

/// A direction and its time.
type Look = (f64, f64);

impl Turn {
    /// Determines the turn from the points' times; without times, or when they are ignored, all at
    /// once. The beams are laid on the cloud's columns where it has so many.
    ///
    /// # Errors
    /// Returns an error when the times are not those of a scanner that turns evenly.
    pub fn of(
        points: &[CloudPoint],
        beams: usize,
        ignores_times: bool,
    ) -> Result<Self, FieldRefused> {
        let stride = points.len().div_ceil(ASKED_MAX).max(1);
        let asked = points.iter().step_by(stride);
        let looks: Vec<Look> = asked
            .map(|point| (point.azimuth_rad(), f64::from(point.time_s)))
            .collect();
        let increment_rad = TAU / beams as f64;
        let at_once = Self {
            beams,
            first_rad: -std::f64::consts::PI,
            increment_rad,
            first_s: 0.0,
            time_increment_s: 0.0,
        };
        if ignores_times {
            return Ok(at_once.on_columns(&looks));
        }
        let Some((first_s, last_s)) = times_of(points)? else {
            return Ok(at_once.on_columns(&looks));
        };
        let (first_rad, speed_radps, follows) = followed(&looks, first_s, last_s);
        if follows < FOLLOWS_MIN {
            let value = format!(
                "times that follow the directions to {:.0} %",
                100.0 * follows
            );
            let accepted = "those of a scanner that turns evenly, once a cloud; or ignore_times";
            return Err(FieldRefused::new("points", value, accepted));
        }
        let turn = Self {
            first_rad,
            increment_rad: increment_rad.copysign(speed_radps),
            first_s,
            time_increment_s: increment_rad / speed_radps.abs(),
            ..at_once
        };
        Ok(turn.on_columns(&looks))
    }

    /// Moves the beams by less than half a step, onto the columns that the directions show.
    fn on_columns(self, looks: &[Look]) -> Self {
        let beams = self.beams as f64;
        let (phase_rad, closeness) = mean_angle(
            looks
                .iter()
                .map(|(azimuth, _)| (azimuth - self.first_rad) * beams),
        );
        if closeness < COLUMNS_MIN {
            return self;
        }
        Self {
            first_rad: self.first_rad + phase_rad / beams,
            ..self
        }
    }

    /// The beam of a point; `None` for one of the turn before or after.
    pub fn beam_of(&self, point: &CloudPoint) -> Option<usize> {
        let steps = (point.azimuth_rad() - self.first_rad) / self.increment_rad;
        let beam = steps.round().rem_euclid(self.beams as f64);
        if self.time_increment_s > 0.0 {
            let beam_s = self.first_s + beam * self.time_increment_s;
            let turn_s = self.time_increment_s * self.beams as f64;
            if (f64::from(point.time_s) - beam_s).abs() > SEAM * turn_s {
                return None;
            }
        }
        Some(beam as usize)
    }
}

/// The first and the last time, s; `None` when all were taken at once.
fn times_of(points: &[CloudPoint]) -> Result<Option<(f64, f64)>, FieldRefused> {
    let times = || points.iter().map(|point| point.time_s);
    if let Some(wrong) = times().find(|time| !(-TIME_MAX_S..=TIME_MAX_S).contains(time)) {
        let value = format!("a time {wrong} s after the stamp");
        return Err(FieldRefused::new("points", value, "within a second of it"));
    }
    let (first, last) = times().fold((f32::INFINITY, f32::NEG_INFINITY), |(first, last), time| {
        (first.min(time), last.max(time))
    });
    let is_rolling = last - first > AT_ONCE_S;
    Ok(is_rolling.then_some((f64::from(first), f64::from(last))))
}

/// The direction at `first_s`, rad, the speed of turning, rad/s, and how closely the looks follow.
fn followed(looks: &[Look], first_s: f64, last_s: f64) -> (f64, f64, f64) {
    let mut speed_radps = mean_speed_radps(looks, first_s, last_s);
    let at_first = |speed_radps: f64| {
        mean_angle(
            looks
                .iter()
                .map(|(azimuth, t)| azimuth - speed_radps * (t - first_s)),
        )
    };
    // Rings may look a little aside of each other: the speed is that of the line through all.
    let middle_s = looks.iter().map(|(_, t)| t).sum::<f64>() / looks.len().max(1) as f64;
    for _ in 0..2 {
        let (first_rad, _) = at_first(speed_radps);
        let (mut along, mut spread) = (0.0, 0.0);
        for (azimuth, t) in looks {
            let off_rad = wrap_angle_rad(azimuth - first_rad - speed_radps * (t - first_s));
            if off_rad.abs() < ASIDE_MAX_RAD {
                along += off_rad * (t - middle_s);
                spread += (t - middle_s) * (t - middle_s);
            }
        }
        if spread > 0.0 {
            speed_radps += along / spread;
        }
    }
    let (first_rad, follows) = at_first(speed_radps);
    (first_rad, speed_radps, follows)
}

/// The mean speed of turning, rad/s, left positive: from the mean directions of short times, so
/// that a stray point does not turn it round.
fn mean_speed_radps(looks: &[Look], first_s: f64, last_s: f64) -> f64 {
    let mut sums = [Vector2::zeros(); MOMENTS];
    for (azimuth, t) in looks {
        let moment = (t - first_s) / (last_s - first_s) * MOMENTS as f64;
        let (s, c) = azimuth.sin_cos();
        if let Some(sum) = sums.get_mut((moment as usize).min(MOMENTS - 1)) {
            *sum += Vector2::new(c, s);
        }
    }
    let seen = (0..MOMENTS)
        .zip(sums)
        .filter(|(_, sum)| *sum != Vector2::zeros());
    let directions: Vec<(usize, f64)> = seen
        .map(|(moment, sum)| (moment, sum.y.atan2(sum.x)))
        .collect();
    let turned_rad = directions.windows(2).map(|pair| match pair {
        [(_, before), (_, after)] => wrap_angle_rad(after - before),
        _ => 0.0,
    });
    let moments = match (directions.first(), directions.last()) {
        (Some((first, _)), Some((last, _))) if last > first => last - first,
        _ => 1,
    };
    let moment_s = (last_s - first_s) / MOMENTS as f64;
    turned_rad.sum::<f64>() / (moments as f64 * moment_s)
}

/// The mean of angles, rad, and how close they lie: 1 for all alike, near 0 for all around.
fn mean_angle(angles_rad: impl Iterator<Item = f64>) -> (f64, f64) {
    let (mut sum, mut count) = (Vector2::zeros(), 0.0_f64);
    for angle in angles_rad {
        let (s, c) = angle.sin_cos();
        sum += Vector2::new(c, s);
        count += 1.0;
    }
    (sum.y.atan2(sum.x), sum.norm() / count.max(1.0))
}
