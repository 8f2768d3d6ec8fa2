//! Systematic errors of a scanner, learnt from the surfaces that it sees twice: a bias of its
//! ranges, and the duration of a scan whose beams carry no times.
//!
//! The measured range of a surface met at the incidence `phi` is modelled as
//! `r + b + c (1 - cos phi)`. A line drawn from points seen under one incidence and met again under
//! another one is off by `b (cos phi - cos phi_map) + c (g(cos phi) - g(cos phi_map))` with
//! `g(x) = x - |x| x`: that distinguishes `b` and `c` from each other and from the motion. A beam
//! taken at the part `s` of the scan moves with its duration `T` by `s (v + omega x q)`: turns and
//! speed determine `T`.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, SMatrix, Vector3};
use serde::{Deserialize, Serialize};

use super::floor::FloorLine;
use super::motion::Motion;
use super::range_errors::RangeErrors;
use super::sensitivity::ScannerEquations;
use crate::scan::Scan;

/// Prior sigma of a scanner's range bias, m: SICK states 25 to 30 mm for its LMS.
const RANGE_BIAS_SIGMA_M: f64 = 0.03;
/// Prior sigma of the further bias at a grazing incidence, m: 1 cm at 60 degrees.
const INCIDENCE_BIAS_SIGMA_M: f64 = 0.02;
/// Sigma at which the range bias counts as learnt, m: it leaves 0.05 mm a second.
const RANGE_BIAS_LEARNT_M: f64 = 0.0015;
/// The same for the bias by incidence, m.
const INCIDENCE_BIAS_LEARNT_M: f64 = 0.003;
/// The same for the duration of a scan, as a part of the time between scans.
const LEARNT_PART: f64 = 0.03;
/// Part of a scan's evidence that counts as new: scans are compared with one and the same map.
const NEW_PART: f64 = 0.1;
/// Part of the evidence that is kept from one evaluated scan to the next: some 100 m of driving
/// count.
const KEPT: f64 = 0.998;
/// Largest step of a bias at once, m.
const BIAS_STEP_MAX_M: f64 = 0.005;

/// Scans on the move after which a scanner without beam times is judged,
const JUDGED_SCANS: u32 = 15;
/// and sigma of a scan's duration below which it is, as a part of the time between scans.
const JUDGED_SIGMA: f64 = 0.06;
/// Least duration of a scan of a scanner that turns, as a part of the time between scans,
const TURNING_MIN: f64 = 0.15;
/// and in sigmas.
const TURNING_SIGMAS: f64 = 6.0;
/// Evaluated scans after which a scanner that was judged not to turn is judged again,
const ASKED_AGAIN_FROM: u32 = 60;
/// up to so many: its first scans may have held the floor, and a map that is drawn without beam
/// times hides most of a duration.
const ASKED_AGAIN_TO: u32 = 500;
/// Least duration of a scan of a scanner that turns after all, as a part of the time between scans,
const HIDDEN_MIN: f64 = 0.02;
/// and in sigmas.
const HIDDEN_SIGMAS: f64 = 3.5;
/// Largest difference, as a part, at which a duration is rounded to the time between scans or to a
/// whole part of it.
const WHOLE_PART: f64 = 0.08;
/// Change of the duration since the map was begun, as a part, that begins the map again,
const REMAP_PART: f64 = 0.04;
/// and in sigmas,
const REMAP_SIGMAS: f64 = 4.0;
/// and evaluated scans on the move since then.
const REMAP_SCANS: u32 = 60;
/// Part of the evidence that is kept then, and when the floor is found in it: it came from a
/// distorted map.
const KEPT_BY_REMAP: f64 = 0.1;
/// Largest duration that is looked for, as a multiple of the longest that the time between scans
/// allows.
const DURATION_MAX: f64 = 1.1;
/// Least uncertainty of a scan's duration, s (one sigma): before a second one was received.
const DURATION_SIGMA_MIN_S: f64 = 1e-3;
/// Number of times between scans that are averaged.
const INTERVALS: f64 = 500.0;
/// Multiple of the mean time between scans beyond which a longer one is a loss,
const LOSS_INTERVALS: f64 = 1.5;
/// and surplus of losses over the other times at which it is not: then the first times were too
/// short.
const LOSSES_MAX: u32 = 10;

/// Times of a scan's beams.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BeamTimes {
    /// Times that the scans state.
    Stated,
    /// Times that no scan states; too little was driven to see whether the scanner turns.
    Unknown,
    /// Times that no scan states, rightly: no motion shows within a scan.
    AtOnce,
    /// Times that the points of which the scans were made lack; not even their order is known.
    Missing,
    /// Times that no scan states, of a scanner that turns: a scan lasts so long.
    Turning {
        /// Duration from the first beam to the last, s.
        duration_s: f64,
        /// Its standard deviation, s.
        sigma_s: f64,
    },
}

/// Knowledge of a scanner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScannerReport {
    /// Times of the beams.
    pub beam_times: BeamTimes,
    /// Bias of its ranges (positive: too long), m, and its standard deviation.
    pub range_bias_m: (f64, f64),
    /// Further bias on a surface that is met at a grazing incidence, m, and its standard deviation.
    pub incidence_bias_m: (f64, f64),
    /// Line of the floor, if the scanner sees it: its plane is tilted.
    pub floor: Option<FloorLine>,
}

/// State of the judgement on a scanner's beam times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Timing {
    #[default]
    Stated,
    Unknown,
    AtOnce,
    Turning,
}

/// Reason to begin a map again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Remap {
    /// Better knowledge of a scan's duration; the poses so far were published with its uncertainty.
    Better,
    /// Scanner that turns although it was judged not to: the poses so far were misled.
    TurnsAfterAll,
}

/// Learns a scanner's systematic errors. The order of its three unknowns: duration, `b`, `c`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scanner {
    values: Vector3<f64>,
    information: Matrix3<f64>,
    timing: Timing,
    /// Scans on the move that were evaluated for their duration.
    asked: u32,
    /// True if it was ever judged not to turn: poses were published as sure then.
    #[serde(default)]
    was_at_once: bool,
    /// The duration that the map was begun with, s.
    mapped_s: f64,
    /// Mean time between scans, s, with the number of them.
    interval_s: f64,
    intervals: f64,
    /// Surplus of the recent losses over the other times between scans.
    #[serde(default)]
    losses: u32,
    /// Part of a turn that a scan covers.
    part_of_turn: f64,
    /// True if its scans are made of points without times.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    lacks_beam_times: bool,
    /// Derivatives of the last scan's pose by each of the unknowns, in this map.
    #[serde(skip)]
    pose_by: Matrix3<f64>,
}

impl Default for Scanner {
    fn default() -> Self {
        Self {
            values: Vector3::zeros(),
            information: Matrix3::zeros(),
            timing: Timing::default(),
            asked: 0,
            was_at_once: false,
            mapped_s: 0.0,
            interval_s: 0.0,
            intervals: 0.0,
            losses: 0,
            part_of_turn: 1.0,
            lacks_beam_times: false,
            pose_by: Matrix3::zeros(),
        }
    }
}

impl Scanner {
    /// The errors of its ranges.
    pub fn range_errors(&self) -> RangeErrors {
        RangeErrors {
            bias_m: self.values[1] as f32,
            incidence_m: self.values[2] as f32,
        }
    }

    /// Time from one beam of a scan to the next, s: stated by the scan, else learnt.
    pub fn time_increment_s(&mut self, scan: &Scan) -> f64 {
        self.lacks_beam_times = scan.lacks_beam_times();
        let stated_s = scan.shape().time_increment_s;
        if stated_s > 0.0 {
            self.timing = Timing::Stated;
            return stated_s;
        }
        if self.timing == Timing::Stated {
            self.timing = Timing::Unknown;
        }
        let beams = scan.ranges_m().len() as f64;
        let span_rad = beams * scan.shape().angle_increment_rad.abs();
        self.part_of_turn = (span_rad / TAU).min(1.0);
        self.duration_in_use_s() / beams
    }

    /// Report of its errors, with its line of the floor.
    pub fn report(&self, floor: Option<FloorLine>) -> ScannerReport {
        let sigma = self.sigmas();
        ScannerReport {
            beam_times: match self.timing {
                _ if self.lacks_beam_times => BeamTimes::Missing,
                Timing::Stated => BeamTimes::Stated,
                Timing::Unknown => BeamTimes::Unknown,
                Timing::AtOnce => BeamTimes::AtOnce,
                Timing::Turning => BeamTimes::Turning {
                    duration_s: self.nearest_whole_s(),
                    sigma_s: sigma[0],
                },
            },
            range_bias_m: (self.values[1], sigma[1]),
            incidence_bias_m: (self.values[2], sigma[2]),
            floor,
        }
    }

    /// Notes the time between two scans, s. Losses make it longer now and then.
    pub fn note_interval(&mut self, interval_s: f64) {
        if self.intervals > 0.0 && interval_s > LOSS_INTERVALS * self.interval_s {
            self.losses += 1;
            if self.losses < LOSSES_MAX {
                return;
            }
            (self.intervals, self.losses) = (0.0, 0);
        }
        self.losses = self.losses.saturating_sub(1);
        self.intervals = (self.intervals + 1.0).min(INTERVALS);
        self.interval_s += (interval_s - self.interval_s) / self.intervals;
    }

    /// True if a scan at this motion is evaluated before the map is updated with one: the beam
    /// times of a moving scanner must be known soon.
    pub fn asks_at_once(&self, motion: &Motion) -> bool {
        self.is_unknown() && is_on_the_move(motion)
    }

    fn is_unknown(&self) -> bool {
        self.timing == Timing::Unknown
    }

    /// Learns from a scan aligned with the map. Returns the reason to begin the map again, if any:
    /// it was drawn with other beam times.
    ///
    /// With the residuals `r` of the aligned scan, their derivatives `D` by the unknowns and `J` by
    /// pose and velocity, whose covariance is `P`, the unknowns' own information is
    /// `A = D'WD - D'WJ P J'WD`, and the Gauss-Newton step `-(A + prior)⁻¹ D'Wr`.
    pub fn learn(&mut self, equations: &ScannerEquations, motion: &Motion) -> Option<Remap> {
        let by_motion: &SMatrix<f64, 3, 6> = &equations.with_motion;
        let eliminated = by_motion * motion.covariance * by_motion.transpose();
        let mut new = equations.information - eliminated;
        let mut pull = equations.gradient;
        let tells_duration = self.timing != Timing::Stated && is_on_the_move(motion);
        self.asked += u32::from(tells_duration);
        // While it may be that the map is drawn with wrong times, it tells of nothing else.
        let is_asked = [tells_duration, !self.is_unknown(), !self.is_unknown()];
        for (index, _) in is_asked.iter().enumerate().filter(|(_, asked)| !**asked) {
            new.row_mut(index).fill(0.0);
            new.column_mut(index).fill(0.0);
            pull[index] = 0.0;
        }
        new = 0.5 * (new + new.transpose());
        if new.symmetric_eigenvalues().min() < -1e-6 * new.amax() {
            return None;
        }
        self.information = self.information * KEPT + new * NEW_PART;
        let prior = self.prior_information();
        let covariance = (self.information + prior).try_inverse()?;
        // The scan was laid out with the duration in use, not with the one estimated so far.
        pull -= new.column(0) * (self.values[0] - self.duration_in_use_s());
        // What fades of the evidence, the prior pulls back.
        let faded = prior * self.values * (1.0 - KEPT);
        let mut step = covariance * (pull * NEW_PART - faded);
        for bias in step.iter_mut().skip(1) {
            *bias = bias.clamp(-BIAS_STEP_MAX_M, BIAS_STEP_MAX_M);
        }
        self.values += step;
        let pose_by = motion.covariance.fixed_rows::<3>(0) * by_motion.transpose();
        self.pose_by = -pose_by;
        if self.timing == Timing::Stated {
            self.pose_by.column_mut(0).fill(0.0);
        }
        self.judge_timing()
    }

    /// Covariance of a scan's pose from what is not yet known of the scanner: `S P S'` (Schmidt).
    /// Scan by scan it is one and the same error and no noise, so it is published only until it is
    /// learnt.
    pub fn pose_covariance(&self) -> Matrix3<f64> {
        let learnt = [
            LEARNT_PART * self.longest_s(),
            RANGE_BIAS_LEARNT_M,
            INCIDENCE_BIAS_LEARNT_M,
        ];
        let sigmas = self.sigmas();
        let unknown = Vector3::from_fn(|i, _| (sigmas[i].powi(2) - learnt[i].powi(2)).max(0.0));
        self.pose_by * Matrix3::from_diagonal(&unknown) * self.pose_by.transpose()
    }

    fn duration_in_use_s(&self) -> f64 {
        if self.timing == Timing::Turning {
            self.nearest_whole_s()
        } else {
            0.0
        }
    }

    /// Duration, rounded to that of a scanner that never stops and sends every scan, or every
    /// second, where it is near: slow scans determine it to some percent only.
    fn nearest_whole_s(&self) -> f64 {
        let duration_s = self.values[0];
        let scans = (self.longest_s() / duration_s).round().max(1.0);
        let whole_s = self.longest_s() / scans;
        if (duration_s - whole_s).abs() < WHOLE_PART * whole_s {
            whole_s
        } else {
            duration_s
        }
    }

    /// Prior information on the unknowns: the duration of a scan is anywhere up to the time between
    /// scans.
    fn prior_information(&self) -> Matrix3<f64> {
        let sigmas = [
            self.longest_s().max(DURATION_SIGMA_MIN_S),
            RANGE_BIAS_SIGMA_M,
            INCIDENCE_BIAS_SIGMA_M,
        ];
        Matrix3::from_diagonal(&Vector3::from(sigmas.map(|sigma| sigma.powi(-2))))
    }

    fn sigmas(&self) -> Vector3<f64> {
        (self.information + self.prior_information())
            .try_inverse()
            .map_or(Vector3::zeros(), |covariance| {
                covariance.diagonal().map(f64::sqrt)
            })
    }

    /// Duration of a scan of a scanner that turns once from scan to scan, s; no scan lasts longer.
    fn longest_s(&self) -> f64 {
        self.interval_s * self.part_of_turn
    }

    fn judge_timing(&mut self) -> Option<Remap> {
        let (sigma_s, longest_s) = (self.sigmas()[0], self.longest_s());
        let takes =
            |part: f64, sigmas: f64| self.values[0] > (part * longest_s).max(sigmas * sigma_s);
        let is_asked_again = self.timing == Timing::AtOnce
            && (ASKED_AGAIN_FROM..ASKED_AGAIN_TO).contains(&self.asked);
        let turns = takes(TURNING_MIN, TURNING_SIGMAS)
            || is_asked_again && takes(HIDDEN_MIN, HIDDEN_SIGMAS);
        let is_known = self.asked >= JUDGED_SCANS && sigma_s < JUDGED_SIGMA * longest_s;
        match self.timing {
            Timing::Unknown if is_known && !turns => {
                self.timing = Timing::AtOnce;
                self.was_at_once = true;
            }
            Timing::Unknown | Timing::AtOnce if is_known && turns => {
                let was_at_once = std::mem::take(&mut self.was_at_once);
                // The map hides a part of it. Most likely the scanner never stops.
                self.timing = Timing::Turning;
                self.remap(longest_s);
                return Some(if was_at_once {
                    Remap::TurnsAfterAll
                } else {
                    Remap::Better
                });
            }
            Timing::Turning => {
                self.values[0] = self.values[0].clamp(0.0, DURATION_MAX * longest_s);
                let duration_s = self.nearest_whole_s();
                let off_s = (duration_s - self.mapped_s).abs();
                let is_off = off_s > (REMAP_PART * longest_s).max(REMAP_SIGMAS * sigma_s);
                if is_off && self.asked >= REMAP_SCANS {
                    self.remap(duration_s);
                    return Some(Remap::Better);
                }
            }
            Timing::Stated | Timing::Unknown | Timing::AtOnce => {}
        }
        None
    }

    /// Returns the part of it that holds in any map.
    pub fn without_map(&self) -> Self {
        Self {
            pose_by: Matrix3::zeros(),
            ..self.clone()
        }
    }

    /// Notes that a map is begun, with the duration in use.
    pub fn note_map(&mut self) {
        self.mapped_s = self.duration_in_use_s();
    }

    /// Widens what was learnt: part of it came from returns that are no wall's. Whether it turns is
    /// judged again.
    pub fn widen(&mut self) {
        self.information *= KEPT_BY_REMAP;
        self.asked = 0;
        if self.timing == Timing::AtOnce {
            self.timing = Timing::Unknown;
        }
        if self.is_unknown() {
            self.values[0] = 0.0;
            self.information.row_mut(0).fill(0.0);
            self.information.column_mut(0).fill(0.0);
        }
    }

    /// Begins to learn in a map that is drawn with scans of another duration.
    fn remap(&mut self, duration_s: f64) {
        self.values[0] = duration_s;
        self.information *= KEPT_BY_REMAP;
        self.asked = 0;
    }
}

/// True if a motion would show within a scan.
fn is_on_the_move(motion: &Motion) -> bool {
    motion.velocity.xy().norm() > 0.1 || motion.velocity.z.abs() > 0.1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(intervals_s: impl Iterator<Item = f64>) -> f64 {
        let mut scanner = Scanner::default();
        intervals_s.for_each(|interval_s| scanner.note_interval(interval_s));
        scanner.longest_s()
    }

    #[test]
    fn losses_do_not_lengthen_the_time_between_scans() {
        for every in [4, 7, 13] {
            let lossy = (1..5000).map(|scan| if scan % every == 0 { 0.368 } else { 0.184 });
            let found_s = after(lossy);
            assert!(
                (found_s - 0.184).abs() < 1e-9,
                "{found_s} s, every {every}th"
            );
        }
    }

    #[test]
    fn a_burst_at_the_beginning_is_forgotten() {
        let found_s = after([0.01, 0.02].into_iter().chain([0.1; 100]));
        assert!((found_s - 0.1).abs() < 1e-3, "{found_s} s");
        // And so is a loss.
        let found_s = after([0.2].into_iter().chain([0.1; 100]));
        assert!((found_s - 0.1).abs() < 2e-3, "{found_s} s");
    }
}
