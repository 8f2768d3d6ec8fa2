//! Trust in a pose: the scan's fit to the map there, and the state that follows from it.

use serde::{Deserialize, Serialize};

use super::correlative_search::Window;
use super::fit::{AGREEMENT_FOUND, Fit};
use super::motion::Motion;

/// Trust in a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tracking {
    /// Scan that fits the map.
    Tracking,
    /// Scan that fits, but a direction is unconstrained or the fit is poor.
    Degraded,
    /// Scan that does not fit: the pose is a guess, and its covariance is as wide.
    Lost,
    /// Scan that is the first to fit again after a loss.
    Recovered,
}

/// Least share of the still points that a fit explains.
const EXPLAINED_MIN: f32 = 0.3;
/// Least share that a pose found again after a loss explains.
const EXPLAINED_RECOVERED_MIN: f32 = 0.5;
/// Largest sigma of a prediction's position within the alignment's basin, m.
const BASIN_M: f64 = 0.05;
/// The same in yaw, rad.
const BASIN_RAD: f64 = 0.03;
/// Part of the recent closeness of the points below which a better pose is searched for.
const CLOSENESS_DROP: f32 = 0.9;
/// Part of the recent closeness below which a scan is lost; one found again has to come nearer to
/// it.
const CLOSENESS_MIN: f32 = 0.4;
/// The same after a loss.
const CLOSENESS_RECOVERED_MIN: f32 = 0.75;
/// Gain of the mean closeness.
const CLOSENESS_GAIN: f32 = 0.1;
/// Least share of agreement at which the robot and its map have not parted.
const AGREEMENT_MIN: f32 = 0.25;
/// Largest speed of a robot that the search allows for, m/s.
const SPEED_MAX_MPS: f64 = 3.0;
/// Largest angular speed that the search allows for, rad/s.
const ANGULAR_SPEED_MAX_RADPS: f64 = 2.5;
/// Scans without a fit after which the map is begun again; a known one is searched widely.
pub const LOST_SCANS_MAX: u32 = 15;
/// Reach of that wide search, m.
const WIDE_REACH_M: f64 = 8.0;

/// The state from scan to scan.
#[derive(Debug, Clone, Copy, Default)]
pub struct Track {
    /// Scans without a fit, in a row.
    lost_scans: u32,
    /// Mean closeness of the fits of late.
    closeness: f32,
    /// Placement in the known map, if there is one.
    known_map: Option<Placed>,
}

/// Placement in a known map: whether a pose in it was found yet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Placed {
    No,
    Yes,
}

impl Track {
    /// True if the prediction is too vague for the alignment to fall into place from it.
    pub fn is_vague(predicted: &Motion) -> bool {
        let (position_m, yaw_rad) = predicted.pose_sigmas();
        position_m > BASIN_M || yaw_rad > BASIN_RAD
    }

    /// True if a better pose should be searched for: the fit is poor, or poorer than those before.
    pub fn distrusts(self, fit: &Fit) -> bool {
        !fit.is_good() || fit.closeness() < CLOSENESS_DROP * self.closeness
    }

    /// Begins in a known map, before the first pose in it.
    pub fn in_known_map() -> Self {
        Self {
            known_map: Some(Placed::No),
            ..Self::default()
        }
    }

    /// True if the scan lies on the map: it explains enough, and not suddenly much less than
    /// before, as after a kidnap. After a loss more is required; a place in a known map is found by
    /// that map's agreement.
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

    /// True if the last scan had no fit.
    pub fn is_lost(self) -> bool {
        self.lost_scans > 0
    }

    /// Forgets the place in a known map and the recent closeness: only the known map counts.
    pub fn forget(&mut self) {
        self.known_map = self.known_map.map(|_| Placed::No);
        self.closeness = 0.0;
    }

    /// True if the loss has lasted so long that the map is given up.
    pub fn gives_up(self) -> bool {
        self.lost_scans >= LOST_SCANS_MAX
    }

    /// Window of the search, `dt` seconds after the last scan: as far as the LiDAR can have come,
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
