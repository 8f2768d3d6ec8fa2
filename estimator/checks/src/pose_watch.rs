//! Poses that a robot sends for its LiDAR: repetition, jumps, and the axis that they turn about.

use fleetcal_model::{Pose2, RobotTime};

use crate::cause::Cause;
use crate::finding::Suspicion;

/// Fewest poses in motion that show anything.
const MOVING_MIN: u32 = 40;
/// Share of repeated poses that is no accident.
const REPEATED_MIN: f64 = 0.4;
/// Speed below which a robot stands, m/s.
const MOVING_MPS: f64 = 0.1;
/// Tilt of the pose's z axis beyond which it is no plane's, rad, and share of such poses.
const TILT_MIN_RAD: f64 = 0.35;
const TILTED_MIN_SHARE: f64 = 0.3;
/// Longest time between two poses that are compared, s.
const GAP_MAX_S: f64 = 1.0;
/// Distance of a jump from the motion before it, m and rad, and the smallest number of jumps.
const JUMP_MIN_M: f64 = 0.12;
const JUMP_MIN_RAD: f64 = 0.06;
const JUMPS_MIN: u32 = 2;
/// Largest change of the velocity from pose to pose, m/s² and rad/s².
const ACCELERATION_MAX: f64 = 3.0;
/// Share of a step by which uneven stamps may put it wrong.
const UNEVEN: f64 = 0.3;
/// Gain of the mean velocity and time between poses.
const GAIN: f64 = 0.3;

/// Poses of one robot.
#[derive(Debug, Clone, Default)]
pub(crate) struct PoseWatch {
    last: Option<(RobotTime, Pose2)>,
    /// Mean velocity of the poses before: along x and y of the pose, and about z.
    velocity: Option<[f64; 3]>,
    /// Mean time between poses, s.
    period_s: f64,
    poses: u32,
    tilted: u32,
    moving: u32,
    repeated: u32,
    jumps: u32,
    largest_jump_m: f64,
    largest_jump_rad: f64,
}

impl PoseWatch {
    /// Adds a pose, the tilt of its z axis, rad, and the speed of the wheels at that time, m/s.
    pub fn take(&mut self, stamp: RobotTime, pose: Pose2, tilt_rad: f64, speed_mps: f64) {
        self.poses = self.poses.saturating_add(1);
        self.tilted += u32::from(tilt_rad > TILT_MIN_RAD);
        let Some((before, last)) = self.last.replace((stamp, pose)) else {
            return;
        };
        let time_s = stamp.seconds_since(before);
        if speed_mps.abs() > MOVING_MPS {
            self.moving += 1;
            self.repeated += u32::from(pose == last);
        }
        if time_s <= 0.0 || time_s > GAP_MAX_S {
            self.velocity = None;
            return;
        }
        self.period_s += GAIN * (time_s - self.period_s);
        if time_s < 0.5 * self.period_s {
            return;
        }
        let step = last.between(&pose).log();
        let [x, y, turn] = self
            .velocity
            .unwrap_or([step.x, step.y, step.z].map(|length| length / time_s));
        let (x_m, y_m, turned_rad) = (x * time_s, y * time_s, turn * time_s);
        let off_m = (step.x - x_m).hypot(step.y - y_m);
        let off_rad = (step.z - turned_rad).abs();
        let normal = ACCELERATION_MAX * time_s * time_s;
        let jumps_m = off_m > JUMP_MIN_M + normal + UNEVEN * x_m.hypot(y_m);
        let jumps_rad = off_rad > JUMP_MIN_RAD + normal + UNEVEN * turned_rad.abs();
        if jumps_m || jumps_rad {
            self.jumps += 1;
            self.largest_jump_m = self.largest_jump_m.max(off_m);
            self.largest_jump_rad = self.largest_jump_rad.max(off_rad);
            // The motion goes on as before the jump.
            return;
        }
        let mean = |before: f64, length: f64| before + GAIN * (length / time_s - before);
        self.velocity = Some([mean(x, step.x), mean(y, step.y), mean(turn, step.z)]);
    }

    /// Returns the suspicion from the poses.
    pub fn suspicions(&self) -> Vec<Suspicion> {
        let mut found = Vec::new();
        let mut say = |cause, seen| found.push(Suspicion::new(cause, seen));
        let (repeated, moving) = (f64::from(self.repeated), f64::from(self.moving));
        if f64::from(self.tilted) > TILTED_MIN_SHARE * f64::from(self.poses)
            && self.poses >= MOVING_MIN
        {
            let share = 100.0 * f64::from(self.tilted) / f64::from(self.poses);
            say(
                Cause::PoseAxes,
                format!(
                    "the z axis of {share:.0} % of the poses is tilted by more than 20 degrees"
                ),
            );
        } else if self.moving >= MOVING_MIN && repeated > REPEATED_MIN * moving {
            let share = 100.0 * repeated / moving;
            say(
                Cause::RepeatedPoses,
                format!("{share:.0} % of the poses repeat the one before while the wheels turn"),
            );
        } else if self.jumps >= JUMPS_MIN {
            let (metres, degrees) = (self.largest_jump_m, self.largest_jump_rad.to_degrees());
            say(
                Cause::PoseJumps,
                format!(
                    "{} poses jump, by up to {metres:.2} m and {degrees:.1} degrees",
                    self.jumps
                ),
            );
        }
        found
    }

    /// Returns `true` once enough poses were seen to judge them.
    pub fn is_judged(&self) -> bool {
        self.moving >= MOVING_MIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn causes(pose: impl Fn(u32) -> Pose2) -> Vec<Cause> {
        let mut watch = PoseWatch::default();
        for number in 0..400 {
            let stamp = RobotTime(1_700_000_000_000_000_000 + i64::from(number) * 100_000_000);
            watch.take(stamp, pose(number), 0.0, 1.0);
        }
        watch.suspicions().into_iter().map(|of| of.cause).collect()
    }

    #[test]
    fn poses_that_repeat_or_jump_are_named() {
        let along = |number: u32| {
            let angle = 0.02 * f64::from(number);
            Pose2::new(5.0 * angle.sin(), 5.0 - 5.0 * angle.cos(), angle)
        };
        assert_eq!(causes(along), []);
        assert_eq!(
            causes(|number| along(number / 10 * 10)),
            [Cause::RepeatedPoses]
        );
        let map = |number: u32| {
            let turned = Pose2::new(0.4, 0.0, 2f64.to_radians());
            if number / 100 % 2 == 1 {
                turned.compose(&along(number))
            } else {
                along(number)
            }
        };
        assert_eq!(causes(map), [Cause::PoseJumps]);
    }
}
