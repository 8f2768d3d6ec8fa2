//! Faults: motion that no calibration explains. Wheels and LiDAR disagree by far, or the steering
//! reading stands still while the vehicle turns.
//!
//! While a fault lasts nothing may be learnt from the data; the calibration is as it was before.

use super::window::Track;
use crate::estimate::Cause;

/// Windows in a row that begin or end a fault.
const IN_A_ROW: usize = 2;
/// Share of the other's way below which wheels or LiDAR disagree.
const DISAGREE_SHARE: f64 = 0.3;
/// Sigma from which the LiDAR's way is not known, m: along a corridor's axis, or in a hall without
/// features.
const ODOMETRY_SIGMA_MAX_M: f64 = 0.05;
/// Speed, faster than any robot, from which it is not known either, m/s.
const ODOMETRY_SPEED_MAX_MPS: f64 = 6.0;
/// Excess of a robot's motion over its drive from which it was carried or towed, m,
const DISPLACED_MIN_M: f64 = 0.2;
/// in standard deviations of the odometry,
const DISPLACED_SIGMAS: f64 = 5.0;
/// and largest share of it that the wheels have driven: at most 0.8 of 1.1 m where two windows
/// share a displacement by 0.3 m.
const DISPLACED_SHARE: f64 = 0.75;
/// Distance of a robot that was lifted away in any direction from where its wheels would be, m,
const LIFTED_MIN_M: f64 = 0.3;
/// and from the way there, m: wheels that slip do not leave it.
const LIFTED_OFF_WAY_M: f64 = 0.05;
/// Shortest way that is compared, m.
const COMPARED_MIN_M: f64 = 0.3;
/// Change below which a reading stands still, rad.
const SAME_READING_RAD: f64 = 1e-6;
/// Windows over which a steering reading has to stand still.
const STUCK_WINDOWS: usize = 6;
/// Windows after which the curves would have shown a stuck sensor: the vehicle keeps to one curve.
const UNDECIDED_WINDOWS_MAX: usize = 2 * STUCK_WINDOWS;
/// Spread of the true steering angle over them, rad (6 degrees): a coarse encoder has less.
const STUCK_SPREAD_RAD: f64 = 0.1;
/// Number of changes of the true angle from window to window, and size of each, rad: a steering
/// zero that jumps does it once or twice.
const STUCK_CHANGES_MIN: usize = 4;
const STUCK_CHANGE_RAD: f64 = 0.015;
/// Standard deviations of a window's angle that spread and changes must exceed, too: a scanner with
/// noisy poses on slow wheels turned far shows each one to a few degrees only.
const STUCK_SPREAD_SIGMAS: f64 = 6.0;
const STUCK_CHANGE_SIGMAS: f64 = 2.6;

/// Fault that is distinguished.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// Moving LiDAR above standing wheels: a dead speed sensor, or somebody pushes.
    NotDriven,
    /// Turning wheels below a standing LiDAR: spinning or lifted wheels, or a LiDAR that sees
    /// nothing of its way.
    NotMoving,
    /// Steering reading that stands still while the vehicle's curve changes.
    StuckSteering,
    /// Disagreement of wheels and LiDAR, while the LiDAR odometry does not know its way.
    OdometryLost,
    /// LiDAR that once came farther than the wheels drove, before they agree again: somebody
    /// carried or towed the robot.
    Displaced,
}

impl Fault {
    /// True if two windows speak for one and the same fault: a lost odometry does not show in every
    /// window.
    fn is_kin(self, other: Self) -> bool {
        self == other || self == Self::OdometryLost || other == Self::OdometryLost
    }

    /// Cause to report.
    pub fn cause(self) -> Cause {
        match self {
            Self::NotDriven | Self::Displaced => Cause::Vehicle,
            Self::OdometryLost => Cause::Odometry,
            Self::NotMoving => Cause::Unknown,
            Self::StuckSteering => Cause::Steering,
        }
    }
}

/// Watches the windows' ways for faults.
#[derive(Debug, Clone, Default)]
pub struct FaultWatch {
    active: Option<Fault>,
    /// Windows in a row that speak for a fault, or for the end of the active one.
    in_a_row: usize,
    last: Option<Fault>,
    /// The last window's way, and how many windows up to it went farther than the wheels drove.
    last_way: Option<Way>,
    displaced: Option<usize>,
    /// Windows with one and the same steering reading, newest last.
    standing: Vec<Track>,
    /// Scale of the noise (as a variance, over the configured one) when the reading began to stand
    /// still: a sensor that sticks makes it look larger still.
    noise_scale: f64,
}

impl FaultWatch {
    /// The present fault.
    pub fn active(&self) -> Option<Fault> {
        self.active
    }

    /// True if the steering reading may have stuck so many windows ago: it has stood still since,
    /// and the curves driven have not decided yet.
    pub fn may_be_stuck(&self, windows: usize) -> bool {
        let standing = self.standing.len();
        standing >= windows.max(2) && standing < UNDECIDED_WINDOWS_MAX
    }

    /// Adds the next window, with the scale of the noise (as a variance, over the configured one);
    /// returns a fault that has just become certain, and how many windows it has lasted.
    pub fn push(&mut self, track: &Track, noise_scale: f64) -> Option<(Fault, usize)> {
        self.follow_steering(track, noise_scale);
        if let Some(active) = self.active {
            let over = match active {
                Fault::StuckSteering => self.standing.len() <= 1,
                Fault::NotDriven | Fault::NotMoving | Fault::OdometryLost | Fault::Displaced => {
                    disagreement(track).is_none()
                }
            };
            self.in_a_row = if over { self.in_a_row + 1 } else { 0 };
            if self.in_a_row >= IN_A_ROW {
                *self = Self::default();
            }
            return None;
        }
        let found = if self.is_stuck() {
            Some((Fault::StuckSteering, self.standing.len()))
        } else {
            self.disagrees(track)
        };
        if let Some((fault, _)) = found {
            self.active = Some(fault);
            self.in_a_row = 0;
        }
        found
    }

    /// Fault of two windows in a row that disagree, or of one that went too far before one that
    /// agrees.
    fn disagrees(&mut self, track: &Track) -> Option<(Fault, usize)> {
        let seen = disagreement(track);
        let way = Way::of(track);
        let with_last = self.last_way.map(|last| last.and(way));
        let was_displaced = self.displaced.take();
        self.last_way = Some(way);
        let is_displaced = way.is_displaced() || is_lifted(track);
        if is_displaced {
            self.displaced = Some(1);
        } else if with_last.is_some_and(Way::is_displaced) {
            self.displaced = Some(2);
        }
        self.in_a_row = match (seen, self.last) {
            (None, _) => 0,
            (Some(now), Some(last)) if now.is_kin(last) => self.in_a_row + 1,
            (Some(_), _) => 1,
        };
        self.last = seen;
        if let Some(windows) = was_displaced
            && seen.is_none()
            && !is_displaced
        {
            return Some((Fault::Displaced, windows + 1));
        }
        seen.filter(|_| self.in_a_row >= IN_A_ROW)
            .map(|fault| (fault, self.in_a_row))
    }

    fn follow_steering(&mut self, track: &Track, noise_scale: f64) {
        let same = track.steering_spread_rad < SAME_READING_RAD
            && self.standing.last().is_none_or(|last| {
                (last.steering_rad - track.steering_rad).abs() < SAME_READING_RAD
            });
        if !same {
            self.standing.clear();
        }
        if self.standing.is_empty() {
            self.noise_scale = noise_scale;
        }
        if track.steering_spread_rad < SAME_READING_RAD {
            if self.standing.len() >= 4 * STUCK_WINDOWS {
                self.standing.remove(0);
            }
            self.standing.push(*track);
        }
    }

    fn is_stuck(&self) -> bool {
        if self.standing.len() < STUCK_WINDOWS {
            return false;
        }
        let by_error =
            |a: &&Track, b: &&Track| a.steering_error_rad.total_cmp(&b.steering_error_rad);
        let tracks = || self.standing.iter();
        let (Some(least), Some(most)) = (tracks().min_by(by_error), tracks().max_by(by_error))
        else {
            return false;
        };
        let pairs = tracks().zip(tracks().skip(1));
        let changes = pairs.filter(|(before, after)| {
            self.differ_by(before, after, STUCK_CHANGE_RAD, STUCK_CHANGE_SIGMAS)
        });
        self.differ_by(least, most, STUCK_SPREAD_RAD, STUCK_SPREAD_SIGMAS)
            && changes.count() >= STUCK_CHANGES_MIN
    }

    /// True if the true steering angles of two windows differ by more than this.
    fn differ_by(&self, a: &Track, b: &Track, least_rad: f64, sigmas: f64) -> bool {
        let apart_rad = (a.steering_error_rad - b.steering_error_rad).abs();
        let sigma_rad = a.steering_sigma_rad.max(b.steering_sigma_rad) * self.noise_scale.sqrt();
        apart_rad > least_rad.max(sigmas * sigma_rad)
    }
}

fn disagreement(track: &Track) -> Option<Fault> {
    let Track {
        driven_m, moved_m, ..
    } = *track;
    let fault = if driven_m.max(moved_m) < COMPARED_MIN_M {
        return None;
    } else if driven_m < DISAGREE_SHARE * moved_m {
        Fault::NotDriven
    } else if moved_m < DISAGREE_SHARE * driven_m {
        Fault::NotMoving
    } else {
        return None;
    };
    // Wheels that disagree with an odometry that does not know its way are not to blame.
    Some(if is_lost(track) {
        Fault::OdometryLost
    } else {
        fault
    })
}

fn is_lost(track: &Track) -> bool {
    track.odometry_sigma_m > ODOMETRY_SIGMA_MAX_M
        || track.moved_m > ODOMETRY_SPEED_MAX_MPS * track.duration_s
}

/// True if the LiDAR, sure of its way, is where no turning of the wheels could have taken it.
fn is_lifted(track: &Track) -> bool {
    let sure_m = DISPLACED_SIGMAS * track.odometry_sigma_m;
    track.odometry_sigma_m < ODOMETRY_SIGMA_MAX_M
        && track.off_m > LIFTED_MIN_M.max(sure_m)
        && track.off_way_m > LIFTED_OFF_WAY_M.max(sure_m)
}

/// Way of the robot over one window or two, by wheels and LiDAR.
#[derive(Debug, Clone, Copy)]
#[expect(clippy::struct_field_names, reason = "the unit is last in a name")]
struct Way {
    driven_m: f64,
    moved_m: f64,
    odometry_sigma_m: f64,
}

impl Way {
    fn of(track: &Track) -> Self {
        Self {
            driven_m: track.driven_m,
            moved_m: track.moved_m,
            odometry_sigma_m: track.odometry_sigma_m,
        }
    }

    /// Way over two windows: a robot may be towed across their border.
    fn and(self, next: Self) -> Self {
        Self {
            driven_m: self.driven_m + next.driven_m,
            moved_m: self.moved_m + next.moved_m,
            odometry_sigma_m: self.odometry_sigma_m.hypot(next.odometry_sigma_m),
        }
    }

    /// True if the LiDAR, sure of its way, has come farther than the wheels drove.
    fn is_displaced(self) -> bool {
        let farther_m = self.moved_m - self.driven_m;
        let sure_m = DISPLACED_SIGMAS * self.odometry_sigma_m;
        self.odometry_sigma_m < ODOMETRY_SIGMA_MAX_M
            && farther_m > DISPLACED_MIN_M.max(sure_m)
            && self.driven_m < DISPLACED_SHARE * self.moved_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track(driven_m: f64, moved_m: f64) -> Track {
        Track {
            driven_m,
            moved_m,
            steering_rad: 0.1,
            steering_spread_rad: 0.01,
            steering_error_rad: 0.0,
            steering_sigma_rad: 0.003,
            duration_s: 1.0,
            off_m: (driven_m - moved_m).abs(),
            off_way_m: (moved_m - driven_m).max(0.0),
            odometry_sigma_m: 0.001,
        }
    }

    #[test]
    fn an_odometry_that_does_not_know_its_way_is_named_not_the_wheels() {
        let mut watch = FaultWatch::default();
        let lost = Track {
            odometry_sigma_m: 0.3,
            ..track(0.05, 0.5)
        };
        assert_eq!(watch.push(&lost, 1.0), None);
        assert_eq!(watch.push(&lost, 1.0), Some((Fault::OdometryLost, 2)));
        assert_eq!(Fault::OdometryLost.cause(), Cause::Odometry);
    }

    #[test]
    fn a_robot_that_was_carried_or_towed_once_is_reported() {
        // Lifted away by 0.5 m at rest; towed by 0.3 m between two stretches of its own.
        for (driven_m, moved_m) in [(0.0, 0.5), (0.12, 0.42), (0.2, 0.5)] {
            let mut watch = FaultWatch::default();
            assert_eq!(watch.push(&track(0.4, 0.4), 1.0), None);
            assert_eq!(watch.push(&track(driven_m, moved_m), 1.0), None);
            let found = watch.push(&track(0.4, 0.4), 1.0);
            assert_eq!(found, Some((Fault::Displaced, 2)), "{driven_m} {moved_m}");
            assert_eq!(watch.push(&track(0.4, 0.4), 1.0), None);
        }
        // Lifted away by 0.5 m to the side, or back.
        for (moved_m, off_way_m) in [(0.64, 0.5), (0.1, 0.1)] {
            let mut watch = FaultWatch::default();
            let lifted = Track {
                off_m: 0.5,
                off_way_m,
                ..track(0.4, moved_m)
            };
            assert_eq!(watch.push(&lifted, 1.0), None);
            let found = watch.push(&track(0.4, 0.4), 1.0);
            assert_eq!(found, Some((Fault::Displaced, 2)), "{moved_m}");
        }
        // Towed by 0.3 m across the border of two windows.
        for driven_m in [0.21, 0.25, 0.29] {
            let mut watch = FaultWatch::default();
            assert_eq!(watch.push(&track(0.4, 0.4), 1.0), None);
            assert_eq!(watch.push(&track(driven_m, 0.4), 1.0), None);
            assert_eq!(watch.push(&track(0.5 - driven_m, 0.4), 1.0), None);
            let found = watch.push(&track(0.4, 0.4), 1.0);
            assert_eq!(found, Some((Fault::Displaced, 3)), "{driven_m}");
        }
        // A jump that the odometry is not sure of is none.
        let mut watch = FaultWatch::default();
        let unsure = Track {
            odometry_sigma_m: 0.2,
            ..track(0.2, 0.45)
        };
        assert_eq!(watch.push(&unsure, 1.0), None);
        assert_eq!(watch.push(&track(0.4, 0.4), 1.0), None);
    }

    #[test]
    fn two_windows_begin_a_fault_and_two_end_it() {
        let mut watch = FaultWatch::default();
        assert_eq!(watch.push(&track(0.0, 0.5), 1.0), None);
        assert_eq!(
            watch.push(&track(0.0, 0.5), 1.0),
            Some((Fault::NotDriven, 2))
        );
        assert_eq!(watch.push(&track(0.0, 0.5), 1.0), None);
        assert_eq!(watch.push(&track(0.5, 0.5), 1.0), None);
        assert_eq!(watch.active(), Some(Fault::NotDriven));
        watch.push(&track(0.5, 0.5), 1.0);
        assert_eq!(watch.active(), None);
    }

    #[test]
    fn one_wild_window_and_a_wrong_scale_are_none() {
        let mut watch = FaultWatch::default();
        for (driven_m, moved_m) in [(0.5, 0.0), (0.5, 0.5), (0.5, 0.3), (0.5, 0.3), (0.2, 0.5)] {
            assert_eq!(watch.push(&track(driven_m, moved_m), 1.0), None);
        }
    }

    #[test]
    fn a_reading_that_stands_still_in_changing_curves_is_stuck() {
        let stuck_with = |noise_scale: f64, error: &dyn Fn(usize) -> f64| {
            let mut watch = FaultWatch::default();
            (0..12).any(|i| {
                let standing = Track {
                    steering_spread_rad: 0.0,
                    steering_error_rad: error(i),
                    ..track(0.5, 0.5)
                };
                watch.push(&standing, noise_scale).is_some()
            })
        };
        let stuck = |error: &dyn Fn(usize) -> f64| stuck_with(1.0, error);
        assert!(stuck(&|i| 0.03 * i as f64));
        assert!(!stuck(&|_| 0.002), "straight ahead");
        assert!(!stuck(&|i| if i < 6 { 0.0 } else { 0.15 }), "a jump");
        // What a tricycle with noisy poses showed on one held curve.
        let held = [0.130, 0.076, 0.110, 0.015, 0.036, -0.002];
        let noisy = |i: usize| held[i % held.len()];
        assert!(stuck(&noisy));
        assert!(!stuck_with(500.0, &noisy), "as uncertain as that");
    }
}
