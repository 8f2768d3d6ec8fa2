//! Outcome of one run: small enough to be kept for every run of a campaign.

use fleetcal_estimator::estimate::{Cause, ChangeKind};
use fleetcal_estimator::{Estimate, Parameter, Status};
use fleetcal_robot::simulator::TrueParameters;
use serde::{Deserialize, Serialize};

use crate::drive::{FOUR, error_of};

/// Number of its own sigmas beyond which the error of a `converged` parameter is a false claim.
pub const FALSE_SIGMAS: f64 = 4.0;

/// The four parameters at one moment: x, y, yaw, steering offset; m and rad.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Time, s.
    pub at_s: f64,
    /// Estimates minus truth.
    pub errors: [f64; 4],
    /// Published standard deviations.
    pub sigmas: [f64; 4],
    /// True for each parameter with the status converged.
    pub converged: [bool; 4],
    /// Normalised error squared over the four, by the published sigmas alone.
    pub nees: f64,
}

impl Snapshot {
    /// Compares the estimate of a moment with the truth.
    pub fn of(at_s: f64, estimate: &Estimate, truth: &TrueParameters) -> Self {
        let each = |of: &dyn Fn(Parameter) -> f64| FOUR.map(of);
        let errors = each(&|p| error_of(p, estimate.parameter(p).value, truth));
        let sigmas = each(&|p| estimate.parameter(p).sigma);
        let squares = errors.iter().zip(&sigmas);
        Self {
            at_s,
            errors,
            sigmas,
            converged: FOUR.map(|p| estimate.parameter(p).status == Status::Converged),
            nees: squares.map(|(error, sigma)| (error / sigma).powi(2)).sum(),
        }
    }

    /// Returns the largest error in sigmas of the converged parameters; 0 without any.
    pub fn worst_claim(&self) -> f64 {
        (0..FOUR.len())
            .filter(|&i| self.converged[i])
            .map(|i| (self.errors[i] / self.sigmas[i]).abs())
            .fold(0.0, f64::max)
    }

    /// True if one of the four is claimed falsely.
    pub fn is_false(&self) -> bool {
        self.worst_claim() > FALSE_SIGMAS
    }

    /// True if all four are converged.
    pub fn all_converged(&self) -> bool {
        self.converged == [true; 4]
    }
}

/// A detected change or fault.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Flagged {
    /// Time of the detection, s.
    pub at_s: f64,
    /// A change or a fault.
    pub kind: ChangeKind,
    /// Cause that it was attributed to.
    pub cause: Cause,
}

/// Outcome of an unchanged robot's run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClaimsOutcome {
    /// Snapshots at 60, 120, 180 and 600 s, as far as the run went.
    pub snapshots: Vec<Snapshot>,
    /// Largest error in sigmas of a converged parameter, at any time.
    pub worst_claim: f64,
    /// Time at which all four were converged first, s.
    pub converged_s: Option<f64>,
    /// Detections although nothing had changed.
    pub flagged: Vec<Flagged>,
    /// Length of the run, s.
    pub length_s: f64,
}

/// Outcome of the run of a robot that changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChangeOutcome {
    /// Time of the change, s.
    pub changed_s: f64,
    /// Snapshot just before.
    pub before: Option<Snapshot>,
    /// Detections before.
    pub too_early: Vec<Flagged>,
    /// First change that was detected afterwards, and the distance driven since, m.
    pub flag: Option<(Flagged, f64)>,
    /// Faults that were detected afterwards.
    pub faults: Vec<Flagged>,
    /// Distance driven after the change until the robot's heading had turned by 45°, m.
    // A run of before this was told is run again.
    #[serde(deserialize_with = "Option::deserialize")]
    pub turned_m: Option<f64>,
    /// Distance driven after the change, m.
    pub driven_m: f64,
    /// Number of estimates published after the change, and of those with a false claim.
    pub told: [u32; 2],
    /// Number of estimates published later than 20 m after the change, and of those with a false
    /// claim.
    pub told_late: [u32; 2],
    /// Snapshot at the end.
    pub end: Option<Snapshot>,
}

/// Outcome of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Outcome of an unchanged robot.
    Claims(ClaimsOutcome),
    /// Outcome of a robot that changed.
    Change(Box<ChangeOutcome>),
}
