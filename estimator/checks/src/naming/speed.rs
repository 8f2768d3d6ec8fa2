//! Unit, sign and life of the speed, by the first equation.

use std::f64::consts::PI;

use fleetcal_odometry::geometry::wrap_angle_rad;

use super::Known;
use crate::cause::Cause;
use crate::finding::Suspicion;
use crate::motion::{Motion, Mount};

/// Speed below which the LiDAR stands, m/s.
const STANDS_MPS: f64 = 0.05;
/// Way that the wheels are ahead where it stands, m.
const STANDS_WAY_MIN_M: f64 = 15.0;
/// Scales that need no word.
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
/// Largest distance of a scale from a unit, as a logarithm.
const UNIT_NEAR: f64 = 0.05;
/// Share of the speed that has to be explained near a unit, and elsewhere.
const EXPLAINED_NEAR: f64 = 0.6;
const EXPLAINED: f64 = 0.85;
/// Yaw from which the LiDAR looks backwards, rad.
const BACKWARDS_RAD: f64 = 2.1;
/// Shares of driving against the sign that are neither noise nor all of it.
const FLIPPED: std::ops::Range<f64> = 0.01..0.99;
/// Distance from the rear axle's middle, m and rad, within which no LiDAR is mounted.
const BASE_MAX: f64 = 0.01;
/// Largest error of a drawing's yaw, rad.
const NOMINAL_OFF_RAD: f64 = 0.5 * PI;

/// Names a wrong speed; returns true if the rest can be judged by it.
pub(super) fn suspicions(motion: &Motion, known: &Known, found: &mut Vec<Suspicion>) -> bool {
    if let Some(dead) = dead(motion, known) {
        found.push(dead);
        return false;
    }
    let Some(mount) = motion.mount.filter(|_| motion.fast_mps > STANDS_MPS) else {
        return false;
    };
    if mount.blind > 0.1 && mount.blind_rows >= 15 {
        let below = mount.blind_below_mps;
        let seen = format!("the speed is 0 while the LiDAR moves at up to {below:.2} m/s");
        found.push(Suspicion::new(Cause::SpeedBlind, seen));
    }
    found.extend(unit(&mount).map(|seen| Suspicion::new(Cause::SpeedUnit, seen)));
    if let Some(unsigned) = unsigned(motion, &mount) {
        found.push(unsigned);
        return false;
    }
    found.extend(direction(motion, &mount, known));
    found.extend(of_base(&mount, known));
    true
}

/// A speed that stays the same, or a LiDAR that does.
fn dead(motion: &Motion, known: &Known) -> Option<Suspicion> {
    let is_moving = motion.fast_mps > STANDS_MPS;
    let ahead_m = known.wheels_way_m - known.way_m;
    let stands =
        motion.fast_mps < 0.02 && motion.sent_largest_mps > 0.1 && ahead_m > STANDS_WAY_MIN_M;
    let is_steady = motion.sent_spread_mps < 1e-3 * motion.sent_mean_mps.abs();
    let (cause, seen) = if stands {
        let (wheels_m, way_m) = (known.wheels_way_m, known.way_m);
        let seen =
            format!("the wheels drove {wheels_m:.1} m and the LiDAR {way_m:.1} m, and it stands");
        (Cause::LidarStands, seen)
    } else if is_moving && motion.sent_largest_mps < 1e-3 {
        let seen = "the LiDAR moves and the speed is 0 all the time".to_owned();
        (Cause::SpeedZero, seen)
    } else if is_moving && is_steady && motion.speed_spread_mps > 0.1 * motion.fast_mps {
        let speed = motion.sent_mean_mps;
        let seen = format!("the speed stays at {speed:.3} while the LiDAR's changes");
        (Cause::SpeedStuck, seen)
    } else {
        return None;
    };
    Some(Suspicion::new(cause, seen))
}

fn unsigned(motion: &Motion, mount: &Mount) -> Option<Suspicion> {
    let flips =
        FLIPPED.contains(&mount.flipped) && mount.flipped * mount.straight_rows as f64 > 8.0;
    let is_so = flips && motion.sent_negative < 0.002 && mount.explained > 0.3;
    is_so.then(|| {
        let share = 100.0 * mount.flipped;
        let seen = format!("in {share:.0} % of the driving the LiDAR goes backwards, and the speed is never negative");
        Suspicion::new(Cause::SpeedUnsigned, seen)
    })
}

/// A LiDAR that moves against the speed: by the speed's sign, by both signs, or since it looks backwards.
fn direction(motion: &Motion, mount: &Mount, known: &Known) -> Option<Suspicion> {
    let steering = motion
        .steering
        .as_ref()
        .filter(|steering| steering.explained > 0.6)?;
    let is_drawn_otherwise =
        |yaw_rad: f64| wrap_angle_rad(mount.yaw_rad - yaw_rad).abs() > NOMINAL_OFF_RAD;
    let seems_backwards = known
        .nominal_yaw_rad
        .map_or(mount.yaw_rad.abs() > BACKWARDS_RAD, is_drawn_otherwise);
    if !seems_backwards || mount.explained < EXPLAINED_NEAR {
        return None;
    }
    let yaw_deg = mount.yaw_rad.to_degrees();
    let seen =
        format!("the LiDAR moves backwards when the speed is positive (yaw {yaw_deg:.1} degrees)");
    Some(if steering.curve.slope() < 0.0 {
        Suspicion::new(Cause::SpeedSign, seen)
    } else {
        Suspicion::new(
            Cause::Backwards,
            format!("{seen}, and the steering goes with it"),
        )
    })
}

/// Poses that move as the rear axle does.
fn of_base(mount: &Mount, known: &Known) -> Option<Suspicion> {
    let is_base =
        mount.x_m.abs() < BASE_MAX && mount.y_m.abs() < BASE_MAX && mount.yaw_rad.abs() < BASE_MAX;
    if !known.sends_poses || !is_base || mount.explained < EXPLAINED {
        return None;
    }
    let (x, y, yaw_deg) = (mount.x_m, mount.y_m, mount.yaw_rad.to_degrees());
    let seen = format!(
        "the poses move as the rear axle does: x {x:.3} m, y {y:.3} m, yaw {yaw_deg:.2} degrees"
    );
    Some(Suspicion::new(Cause::BasePose, seen))
}

/// Returns `true` if a mount is beside the vehicle's middle line or turned: there no frame of the vehicle is.
pub(crate) fn is_off_centre(mount: &Mount) -> bool {
    let is_off = mount.y_m.abs() > BASE_MAX || mount.yaw_rad.abs() > BASE_MAX;
    is_off && mount.explained > EXPLAINED
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
