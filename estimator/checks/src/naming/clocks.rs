//! Clocks that are apart, and wheels of another vehicle.

use super::Known;
use crate::cause::Cause;
use crate::finding::Suspicion;
use crate::lag::Lag;
use crate::motion::{LAG_MAX_S, Motion};

/// Smallest time between clocks that are apart, s; the estimator follows a smaller one.
const APART_MIN_S: f64 = 0.3;
/// Correlation at which the motion agrees, and how much less of it stays unexplained there than without
/// a lag.
const AGREES: f64 = 0.9;
const LESS_UNEXPLAINED: f64 = 2.0;
/// Correlation below which nothing agrees.
const DISAGREES: f64 = 0.6;
/// Seconds that time scales are apart: GPS from UTC, TAI from UTC.
const SCALES: [(f64, &str); 2] = [(18.0, "GPS time"), (37.0, "TAI")];
/// Way before two vehicles are distinguished, m.
const OTHER_WAY_MIN_M: f64 = 15.0;
/// Largest yaw rate of a LiDAR that stays straight, rad/s, while angles as wide as this steer, rad.
const TURN_MIN_RADPS: f64 = 0.03;
const STEERED_MIN_RAD: f64 = 0.1;

/// Names clocks that are apart by the motion; returns true if they are.
pub(super) fn suspicions(motion: &Motion, known: &Known, found: &mut Vec<Suspicion>) -> bool {
    let (speed, steering) = (motion.by_speed, motion.by_steering);
    let by_steering = steering.correlation > 0.85
        && (steering.sigma_s < speed.sigma_s || speed.correlation < 0.7);
    let used = if by_steering { steering } else { speed };
    let apart_s = known.aligned_s + used.late_s;
    let both = (speed.late_s - steering.late_s).abs()
        < 0.1 + 2.0 * (speed.sigma_s + steering.sigma_s)
        && speed.sigma_s < 0.2
        && speed.correlation > 0.8;
    let agrees = |lag: Lag| {
        let unexplained = |correlation: f64| 1.0 - correlation * correlation;
        let is_better =
            unexplained(lag.unshifted) > LESS_UNEXPLAINED * unexplained(lag.correlation);
        lag.correlation > AGREES && (is_better || lag.late_s.abs() < APART_MIN_S)
    };
    // What was aligned by arrival already is named by that.
    let is_apart = used.late_s.abs() > APART_MIN_S && both && agrees(used);
    if is_apart && apart_s.abs() > APART_MIN_S {
        let seen = format!(
            "scans are stamped {:+.2} s against the wheels: the motion agrees then ({:.2}){}",
            -apart_s,
            used.correlation,
            explanation(apart_s)
        );
        found.push(Suspicion::new(Cause::ClocksApart, seen));
    }
    is_apart
}

/// Words for a time between clocks that has a well-known reason.
pub(crate) fn explanation(apart_s: f64) -> String {
    let quarters = (apart_s / 900.0).round();
    if quarters != 0.0 && (apart_s - 900.0 * quarters).abs() < 9.0 && quarters.abs() < 57.0 {
        return format!(", a time zone of {:+} h", -quarters / 4.0);
    }
    let scale = SCALES
        .iter()
        .find(|(seconds, _)| (apart_s.abs() - seconds).abs() < 0.5);
    scale.map_or_else(String::new, |(_, name)| format!(", as {name} is from UTC"))
}

/// Names wheels of another vehicle; returns true if they are.
pub(super) fn are_of_two(motion: &Motion, known: &Known, found: &mut Vec<Suspicion>) -> bool {
    let Some(mount) = motion.mount else {
        return false;
    };
    let (speed, steering) = (motion.by_speed.correlation, motion.by_steering.correlation);
    let most = speed.max(steering).max(mount.correlation);
    let varies = motion.speed_spread_mps > 0.1 * motion.fast_mps
        && motion.sent_spread_mps > 0.05 * motion.sent_largest_mps;
    if known.way_m < OTHER_WAY_MIN_M || most > DISAGREES || !varies {
        return false;
    }
    let stays_straight =
        motion.turn_radps < TURN_MIN_RADPS && motion.angle_width_rad > STEERED_MIN_RAD;
    if stays_straight || known.lost_its_way {
        let seen = if stays_straight {
            "the LiDAR seems not to turn while the wheels steer"
        } else {
            "LiDAR odometry loses its way, and does not go with the wheels"
        };
        found.push(Suspicion::new(Cause::LidarMisled, seen.to_owned()));
        return true;
    }
    let seen = format!(
        "wheels and LiDAR move together at no time offset up to {LAG_MAX_S} s: speeds agree by {:.2}, yaw \
         rates by {steering:.2}",
        speed.max(mount.correlation)
    );
    found.push(Suspicion::new(Cause::OtherVehicle, seen));
    true
}
