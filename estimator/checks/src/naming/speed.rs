//! Unit, sign and life of the speed, by the first equation.

use std::f64::consts::PI;

use fleetcal_estimator::geometry::wrap_angle_rad;

use super::Known;
use crate::cause::Cause;
use crate::finding::Suspicion;
use crate::motion::{Motion, Mount};

/// The LiDAR stands below this speed, m/s.
const STANDS_MPS: f64 = 0.05;
/// Way that the wheels are ahead where it stands, m.
const STANDS_WAY_MIN_M: f64 = 15.0;
/// Scales within these need no word.
const SCALE_OK: std::ops::Range<f64> = 0.8..1.25;
/// Units by the metres a second of one of theirs.
const UNITS: [(f64, &str); 6] = [
    (1.0 / 3.6, "km/h"),
    (1e-3, "mm/s"),
    (1e-2, "cm/s"),
    (0.447_04, "miles an hour"),
    (
        0.5,
        "twice the speed, as by a wheel's diameter taken for its radius",
    ),
    (2.0, "half the speed"),
];
/// How near to a unit a scale is, as a logarithm.
const UNIT_NEAR: f64 = 0.05;
/// Share of the speed that has to be explained near a unit, and elsewhere.
const EXPLAINED_NEAR: f64 = 0.6;
const EXPLAINED: f64 = 0.85;
/// Yaw from which the LiDAR looks backwards, rad.
const BACKWARDS_RAD: f64 = 2.1;
/// Shares of driving against the sign that are neither noise nor all of it.
const FLIPPED: std::ops::Range<f64> = 0.01..0.99;
/// A drawing's yaw is wrong by no more, rad.
const NOMINAL_OFF_RAD: f64 = 0.5 * PI;

/// Names what is wrong with the speed; says whether the rest can be judged by it.
pub(super) fn suspicions(motion: &Motion, known: &Known, found: &mut Vec<Suspicion>) -> bool {
    let mut say = |cause, seen| found.push(Suspicion::new(cause, seen));
    let is_moving = motion.fast_mps > STANDS_MPS;
    if is_moving && motion.sent_largest_mps < 1e-3 {
        say(
            Cause::SpeedZero,
            "the LiDAR moves and the speed is 0 all the time".to_owned(),
        );
        return false;
    }
    if !is_moving {
        let ahead_m = known.wheels_way_m - known.way_m;
        if motion.sent_largest_mps > 0.1 && motion.fast_mps < 0.02 && ahead_m > STANDS_WAY_MIN_M {
            let (wheels_m, way_m) = (known.wheels_way_m, known.way_m);
            say(
                Cause::LidarStands,
                format!(
                    "the wheels drove {wheels_m:.1} m and the LiDAR {way_m:.1} m, and it stands"
                ),
            );
        }
        return false;
    }
    let is_steady = motion.sent_spread_mps < 1e-3 * motion.sent_mean_mps.abs();
    if is_steady && motion.speed_spread_mps > 0.1 * motion.fast_mps {
        let speed = motion.sent_mean_mps;
        say(
            Cause::SpeedStuck,
            format!("the speed stays at {speed:.3} while the LiDAR's changes"),
        );
        return false;
    }
    let Some(mount) = motion.mount else {
        return false;
    };
    if mount.blind > 0.1 && mount.blind_rows >= 15 {
        let below = mount.blind_below_mps;
        say(
            Cause::SpeedBlind,
            format!("the speed is 0 while the LiDAR moves at up to {below:.2} m/s"),
        );
    }
    if let Some(seen) = unit(&mount) {
        say(Cause::SpeedUnit, seen);
    }
    let flips =
        FLIPPED.contains(&mount.flipped) && mount.flipped * mount.straight_rows as f64 > 8.0;
    if flips && motion.sent_negative < 0.002 && mount.explained > 0.3 {
        let share = 100.0 * mount.flipped;
        say(
            Cause::SpeedUnsigned,
            format!(
                "in {share:.0} % of the driving the LiDAR goes backwards, and the speed is never negative"
            ),
        );
        return false;
    }
    let yaw_deg = mount.yaw_rad.to_degrees();
    let is_drawn_otherwise =
        |yaw_rad: f64| wrap_angle_rad(mount.yaw_rad - yaw_rad).abs() > NOMINAL_OFF_RAD;
    let seems_backwards = mount.explained > EXPLAINED_NEAR
        && known
            .nominal_yaw_rad
            .map_or(mount.yaw_rad.abs() > BACKWARDS_RAD, is_drawn_otherwise);
    let parity = motion
        .steering
        .as_ref()
        .filter(|steering| steering.explained > 0.6);
    if let Some(steering) = parity.filter(|_| seems_backwards) {
        let seen = format!(
            "the LiDAR moves backwards when the speed is positive (yaw {yaw_deg:.1} degrees)"
        );
        if steering.curve.slope() < 0.0 {
            say(Cause::SpeedSign, seen);
        } else {
            say(
                Cause::Backwards,
                format!("{seen}, and the steering goes with it"),
            );
        }
    }
    let is_base = mount.x_m.abs() < 0.01 && mount.y_m.abs() < 0.01 && mount.yaw_rad.abs() < 0.01;
    if known.sends_poses && is_base && mount.explained > EXPLAINED {
        let (x, y) = (mount.x_m, mount.y_m);
        say(
            Cause::BasePose,
            format!(
                "the poses move as the rear axle does: x {x:.3} m, y {y:.3} m, yaw {yaw_deg:.2} degrees"
            ),
        );
    }
    true
}

fn unit(mount: &Mount) -> Option<String> {
    let scale = mount.scale;
    let off = |unit: f64| (scale / unit).ln().abs();
    let (unit, name) = UNITS
        .into_iter()
        .min_by(|a, b| off(a.0).total_cmp(&off(b.0)))?;
    let is_near = off(unit) < UNIT_NEAR;
    let explained = if is_near { EXPLAINED_NEAR } else { EXPLAINED };
    if SCALE_OK.contains(&scale) || mount.explained < explained {
        return None;
    }
    let moved = format!("the LiDAR moves {scale:.4} m for each reported metre");
    Some(if is_near {
        format!("{moved}: {name}")
    } else {
        format!("{moved}: turns of a wheel of that radius (rad/s), or a gear")
    })
}
