//! Unit, sign and zero of the steering angle, wheelbase, model and delays, by the second equation.

use super::Known;
use crate::cause::Cause;
use crate::curve::Curve;
use crate::finding::Suspicion;
use crate::motion::{Motion, Steering};

/// Width of the curves, times the wheelbase, below which they show nothing of the steering.
const CURVE_MIN: f64 = 0.12;
/// Share of the curve that the angle has to explain before anything is named, and before numbers
/// are.
const EXPLAINED: f64 = 0.6;
const EXPLAINED_WELL: f64 = 0.9;
/// Turns of the vehicle, over those by angle and wheelbase, that are accepted.
const TURNS_OK: std::ops::Range<f64> = 0.85..1.18;
/// Accepted turns of a vehicle that turned to one side alone: the zero is not known then.
const TURNS_OK_ONE_SIDED: std::ops::Range<f64> = 0.6..1.7;
/// Deviations from which a slope has a sign, and a size.
const SIGN_SIGMAS: f64 = 6.0;
const SIZE_SIGMAS: f64 = 10.0;
/// Ratio of two residuals, as a logarithm, that rules out the larger one's explanation.
const BETTER: f64 = 0.05;
/// Largest residual of an accepted explanation, over the smallest of any.
const AS_GOOD: f64 = 1.3;
/// Smallest zero that is named, degrees.
const ZERO_MIN_DEG: f64 = 15.0;
/// Way before a model, a linkage or a command is named, m.
const LONG_WAY_M: f64 = 10.0;

/// Names a wrong steering.
pub(super) fn suspicions(
    motion: &Motion,
    known: &Known,
    is_apart: bool,
    found: &mut Vec<Suspicion>,
) {
    let mut say = |cause, seen| found.push(Suspicion::new(cause, seen));
    if motion.curve_width < CURVE_MIN {
        return;
    }
    if motion.angle_width_rad < 1e-3 {
        let angle = motion.angle_rad;
        say(
            Cause::SteeringStuck,
            format!("the angle stays at {angle:.3} while the vehicle turns"),
        );
        return;
    }
    let Some(steering) = &motion.steering else {
        return;
    };
    if steering.explained < EXPLAINED {
        if known.way_m > 15.0 && steering.curve.rms > 0.05 && !is_apart {
            let share = 100.0 * steering.explained.max(0.0);
            say(
                Cause::SteeringUnrelated,
                format!("the angle explains {share:.0} % of the curve driven"),
            );
        }
        return;
    }
    let slope = steering.curve.slope();
    if slope < 0.0
        && steering.sigmas > SIGN_SIGMAS
        && !found.iter().any(|of| of.cause == Cause::SpeedSign)
    {
        found.push(Suspicion::new(
            Cause::SteeringSign,
            "the vehicle turns left when the angle says right, and right when it says left"
                .to_owned(),
        ));
    }
    found.extend(size(motion, steering, known));
    if let Some(zero) = zero_deg(motion, steering) {
        let seen = format!("the angle shows {zero:.0} degrees straight ahead");
        found.push(Suspicion::new(Cause::SteeringZero, seen));
    }
    if known.way_m < LONG_WAY_M || is_apart {
        return;
    }
    found.extend(model(motion, known));
    found.extend(linkage(steering));
    found.extend(delay(motion, steering));
}

/// Unit or gear of the angle, or another wheelbase.
fn size(motion: &Motion, steering: &Steering, known: &Known) -> Option<Suspicion> {
    let slope = steering.curve.slope();
    let turns = slope.abs();
    if (turns.to_degrees().ln()).abs() < 0.15 && steering.sigmas > SIZE_SIGMAS {
        let seen = format!("the vehicle turns {turns:.4} times as much as the angle says: degrees");
        return Some(Suspicion::new(Cause::SteeringDegrees, seen));
    }
    let accepted = if steering.both_sides {
        TURNS_OK
    } else {
        TURNS_OK_ONE_SIDED
    };
    let speed_fits = motion.mount.is_some_and(|mount| mount.explained > 0.8);
    let is_certain = steering.sigmas > SIZE_SIGMAS && steering.explained > EXPLAINED_WELL;
    if accepted.contains(&turns) || !speed_fits || !is_certain {
        return None;
    }
    let (gear, wheelbase) = (steering.gear?, steering.wheelbase?);
    let best = steering.curve.rms;
    let is_as_good = |curve: &Curve| curve.rms < AS_GOOD * best;
    // The slope of the freest curve is little worth where the angles were alike.
    let is_right = |curve: &Curve, turns: f64| is_as_good(curve) && accepted.contains(&turns);
    if is_right(&gear, gear.gear.abs()) || is_right(&wheelbase, wheelbase.c.abs()) {
        return None;
    }
    let lead = (wheelbase.rms / gear.rms).ln();
    let wheelbase_m = known.wheelbase_m / wheelbase.c.abs();
    let (cause, seen) = if turns < 0.2 || (lead > BETTER && is_as_good(&gear)) {
        let seen = format!(
            "the vehicle turns {:.4} times as much as the angle says: that of a column or motor, gear {:.2}",
            gear.gear.abs(),
            1.0 / gear.gear.abs()
        );
        (Cause::SteeringGear, seen)
    } else if lead < -BETTER && is_as_good(&wheelbase) {
        let seen = format!(
            "the vehicle turns like one of {wheelbase_m:.2} m, not {:.2} m{}",
            known.wheelbase_m,
            if (1.6..2.4).contains(&turns) {
                ", or both axles steer"
            } else {
                ""
            }
        );
        (Cause::WheelbaseWrong, seen)
    } else {
        let seen = format!(
            "the vehicle turns {turns:.2} times as much as angle and wheelbase say: a wheelbase of {wheelbase_m:.2} m \
             or a gear of {:.2}",
            1.0 / turns
        );
        (Cause::TurnScale, seen)
    };
    Some(Suspicion::new(cause, seen))
}

fn zero_deg(motion: &Motion, steering: &Steering) -> Option<f64> {
    let slope = steering.curve.slope().abs();
    // Of degrees, columns and motors the zero is counted in their own unit.
    let is_angle = slope > 0.3 && motion.mount.is_some();
    let zero = (steering.curve.zero_rad / steering.curve.gear).to_degrees();
    let is_far =
        zero.abs() > ZERO_MIN_DEG && steering.explained > EXPLAINED_WELL && steering.both_sides;
    (is_angle && is_far).then_some(zero)
}

fn model(motion: &Motion, known: &Known) -> Option<Suspicion> {
    let mount = motion.mount?;
    let (axle, wheel) = (1e3 * mount.residual_axle, 1e3 * mount.residual_wheel);
    let is_at_steered_wheel = motion.is_at_steered_wheel()?;
    if is_at_steered_wheel == known.is_at_steered_wheel {
        return None;
    }
    Some(if is_at_steered_wheel {
        Suspicion::new(
            Cause::Tricycle,
            format!(
                "the speed is that of the steered wheel: it leaves {wheel:.0} mm/s, the fixed axle's {axle:.0}"
            ),
        )
    } else {
        Suspicion::new(
            Cause::Bicycle,
            format!(
                "the speed is that of the fixed axle: it leaves {axle:.0} mm/s, the steered wheel's {wheel:.0}"
            ),
        )
    })
}

/// Smallest half track over the wheelbase of a linkage, and the largest share of the residuals that it
/// leaves.
const HALF_TRACK_MIN: f64 = 0.15;
const LINKAGE_LEAVES_MAX: f64 = 0.6;

fn linkage(steering: &Steering) -> Option<Suspicion> {
    let (half_track, leaves) = steering.linkage?;
    let slope = steering.curve.slope();
    let is_plain = (0.85..1.18).contains(&slope.abs()) && steering.both_sides;
    if !is_plain || half_track.abs() < HALF_TRACK_MIN || leaves > LINKAGE_LEAVES_MAX {
        return None;
    }
    let (less, wheel) = if half_track > 0.0 {
        ("less", "left")
    } else {
        ("more", "right")
    };
    let seen = format!(
        "the vehicle turns {less} to the left than to the right at the same angle: that of the {wheel} wheel"
    );
    Some(Suspicion::new(Cause::LinkageWheel, seen))
}

/// Deviations of a delay that are left out.
const DELAY_SIGMAS: f64 = 2.5;
/// Largest deviation of a delay that is named, s.
const DELAY_SIGMA_MAX_S: f64 = 0.06;
/// Largest delay of a steering that is an actuator's, s.
const COMMAND_MIN_S: f64 = 0.12;
const LATE_MIN_S: f64 = 0.1;
const SPEED_LATE_MIN_S: f64 = 0.05;

fn delay(motion: &Motion, steering: &Steering) -> Option<Suspicion> {
    let (speed, angle) = (motion.by_speed, motion.by_steering);
    let sigma_s = speed.sigma_s.hypot(angle.sigma_s);
    let is_clear = speed.correlation > 0.8
        && angle.correlation > 0.9
        && steering.explained > 0.8
        && angle.sigma_s < 0.05
        && sigma_s < DELAY_SIGMA_MAX_S;
    if !is_clear {
        return None;
    }
    let leads_s = speed.late_s - angle.late_s;
    let beyond = |least_s: f64, delay_s: f64| delay_s - DELAY_SIGMAS * sigma_s > least_s;
    let both_ms = |delay_s: f64| (1e3 * delay_s, 2e3 * sigma_s);
    let speed_is_alone = angle.late_s.abs() < 0.06 && speed.late_s.abs() > 0.08;
    let (cause, seen) = if speed_is_alone && beyond(SPEED_LATE_MIN_S, leads_s.abs()) {
        let (late, sigma) = both_ms(speed.late_s);
        (
            Cause::SpeedLate,
            format!("the speed shows each change {late:.0} ± {sigma:.0} ms after LiDAR and angle"),
        )
    } else if beyond(COMMAND_MIN_S, leads_s) && leads_s < 0.6 {
        let (late, sigma) = both_ms(leads_s);
        (
            Cause::Command,
            format!("the vehicle follows the angle {late:.0} ± {sigma:.0} ms later than the speed"),
        )
    } else if beyond(LATE_MIN_S, -leads_s) {
        let (late, sigma) = both_ms(-leads_s);
        (
            Cause::AngleLate,
            format!("the angle shows a turn {late:.0} ± {sigma:.0} ms after the vehicle makes it"),
        )
    } else {
        return None;
    };
    Some(Suspicion::new(cause, seen))
}
