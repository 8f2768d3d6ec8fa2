//! Trust in a pose: the scan's fit to the map there, and the state that follows from it.

use serde::{Deserialize, Serialize};

use super::correlative_search::Window;
use super::fit::{AGREEMENT_FOUND, Fit};
use super::motion::Motion;

/// Whether the pose can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tracking {
    /// The scan fits the map.
    Tracking,
    /// It fits, but a direction is unconstrained or the fit is poor.
    Degraded,
    /// It does not fit: the pose is a guess, and its covariance says so.
    Lost,
    /// The first scan that fits again after a loss.
    Recovered,
}

/// A fit that explains less than this share of the still points is not a fit.
const EXPLAINED_MIN: f32 = 0.3;
/// A pose found again after a loss has to explain this share.
const EXPLAINED_RECOVERED_MIN: f32 = 0.5;
/// A prediction vaguer than this in position (one sigma) may lie outside the alignment's basin, m.
const BASIN_M: f64 = 0.05;
/// The same in yaw, rad.
const BASIN_RAD: f64 = 0.03;
/// The search is also asked when the points lie less close than this part of what they did of late.
const CLOSENESS_DROP: f32 = 0.9;
/// A scan less close than this part is lost; one found again has to come nearer to it.
const CLOSENESS_MIN: f32 = 0.4;
/// The same after a loss.
const CLOSENESS_RECOVERED_MIN: f32 = 0.75;
/// Gain of the mean closeness.
const CLOSENESS_GAIN: f32 = 0.1;
/// Below this share the robot and its map have parted.
const AGREEMENT_MIN: f32 = 0.25;
/// Largest speed of a robot that the search allows for, m/s.
const SPEED_MAX_MPS: f64 = 3.0;
/// Largest angular speed that the search allows for, rad/s.
const ANGULAR_SPEED_MAX_RADPS: f64 = 2.5;
/// After so many scans without a fit the map is begun again; one known before is searched widely.
pub const LOST_SCANS_MAX: u32 = 15;
/// How far, m.
const WIDE_REACH_M: f64 = 8.0;

/// The state from scan to scan.
#[derive(Debug, Clone, Copy, Default)]
pub struct Track {
    /// Scans without a fit, in a row.
    lost_scans: u32,
    /// Mean closeness of the fits of late.
    closeness: f32,
    /// Whether the map was known before, and whether a pose in it was found yet.
    known_map: Option<Placed>,
}

/// Whether a pose in a known map was found yet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Placed {
    No,
    Yes,
}

impl Track {
    /// Whether the prediction is too vague for the alignment to fall into place from it.
    pub fn is_vague(predicted: &Motion) -> bool {
        let (position_m, yaw_rad) = predicted.pose_sigmas();
        position_m > BASIN_M || yaw_rad > BASIN_RAD
    }

    /// Whether a better pose should be looked for: the fit is poor, or poorer than those before.
    pub fn distrusts(self, fit: &Fit) -> bool {
        !fit.is_good() || fit.closeness() < CLOSENESS_DROP * self.closeness
    }

    /// Before the first pose in a map that was known before.
    pub fn in_known_map() -> Self {
        Self {
            known_map: Some(Placed::No),
            ..Self::default()
        }
    }

    /// Whether the scan lies on the map: it explains enough, and not suddenly much less than of
    /// late, as after a kidnap. To be found again takes more; a place in a known map is found by
    /// what that map says.
    pub fn accepts(self, fit: &Fit) -> bool {
        if self.known_map == Some(Placed::No) {
            return fit.places();
        }
        let (explained_min, closeness_part, agreement_min) = if self.is_lost() {
            (
                EXPLAINED_RECOVERED_MIN,
                CLOSENESS_RECOVERED_MIN,
                AGREEMENT_FOUND,
            )
        } else {
            (EXPLAINED_MIN, CLOSENESS_MIN, AGREEMENT_MIN)
        };
        fit.explained() >= explained_min
            && fit.closeness() >= closeness_part * self.closeness
            && fit.agreement().is_none_or(|share| share >= agreement_min)
    }

    /// Whether the last scan had no fit.
    pub fn is_lost(self) -> bool {
        self.lost_scans > 0
    }

    /// What was seen is given up: only what was known before counts.
    pub fn forget(&mut self) {
        self.known_map = self.known_map.map(|_| Placed::No);
        self.closeness = 0.0;
    }

    /// Whether the loss has lasted so long that the map is given up.
    pub fn gives_up(self) -> bool {
        self.lost_scans >= LOST_SCANS_MAX
    }

    /// How far to search, `dt` seconds after the last scan: as far as the LiDAR can have come,
    /// and after a loss farther and farther. A known map is searched widely now and then.
    pub fn window(self, dt: f64) -> Window {
        match self.lost_scans {
            0 => Window {
                reach_m: (SPEED_MAX_MPS * dt).clamp(0.4, 2.5),
                yaw_rad: (ANGULAR_SPEED_MAX_RADPS * dt).clamp(0.25, std::f64::consts::PI),
            },
            1 | 2 => Window {
                reach_m: 1.6,
                yaw_rad: 1.05,
            },
            n if self.known_map.is_some() && n.is_multiple_of(LOST_SCANS_MAX) => Window {
                reach_m: WIDE_REACH_M,
                yaw_rad: std::f64::consts::PI,
            },
            _ => Window {
                reach_m: 3.2,
                yaw_rad: std::f64::consts::PI,
            },
        }
    }

    /// Notes a scan that fits.
    pub fn found(&mut self, fit: &Fit, is_open: bool) -> Tracking {
        let was_lost = self.is_lost();
        self.lost_scans = 0;
        self.known_map = self.known_map.map(|_| Placed::Yes);
        self.closeness += CLOSENESS_GAIN * (fit.closeness() - self.closeness);
        if was_lost {
            Tracking::Recovered
        } else if is_open || !fit.is_good() {
            Tracking::Degraded
        } else {
            Tracking::Tracking
        }
    }

    /// Notes a scan that does not fit.
    pub fn lost(&mut self) -> Tracking {
        self.lost_scans += 1;
        Tracking::Lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scan of a real robot in an office, half of whose points were on people.
    #[test]
    fn a_scan_that_people_cover_by_half_is_not_lost() {
        let crowded = Fit {
            points: 103.0,
            on_map: 29.0,
            moving: 47.0,
            score: 26.6,
            score_of_moving: 1.0,
            ..Fit::default()
        };
        let track = Track {
            closeness: 0.666,
            ..Track::default()
        };
        assert!(track.accepts(&crowded));
        // Still points that lie nowhere near the map are no people.
        let elsewhere = Fit {
            moving: 0.0,
            score_of_moving: 0.0,
            ..crowded
        };
        assert!(!track.accepts(&elsewhere));
    }
}
