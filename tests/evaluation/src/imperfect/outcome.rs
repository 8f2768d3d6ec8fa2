//! Outcome of one run: small enough to be kept for every run of a campaign.

use fleetcal_estimator::estimate::{Cause, ChangeKind};
use fleetcal_estimator::{Estimate, Parameter, Status};
use fleetcal_robot::simulator::TrueParameters;
use serde::{Deserialize, Serialize};

use crate::drive::{FOUR, error_of};

/// A false claim is `converged` and farther off than this many of its own sigmas.
pub const FALSE_SIGMAS: f64 = 4.0;

/// The four parameters at one moment: x, y, yaw, steering offset; m and rad.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Time, s.
    pub at_s: f64,
    /// Estimates less truth.
    pub errors: [f64; 4],
    /// Published standard deviations.
    pub sigmas: [f64; 4],
    /// Whether each was called converged.
    pub converged: [bool; 4],
    /// Normalised error squared over the four: by the published sigmas alone, as long as no
    /// covariance is published.
    pub nees: f64,
}

impl Snapshot {
    /// The estimate of a moment against the truth.
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

    /// Largest error in sigmas of those called converged; 0 when none is.
    pub fn worst_claim(&self) -> f64 {
        (0..FOUR.len())
            .filter(|&i| self.converged[i])
            .map(|i| (self.errors[i] / self.sigmas[i]).abs())
            .fold(0.0, f64::max)
    }

    /// Whether one of the four is claimed falsely.
    pub fn is_false(&self) -> bool {
        self.worst_claim() > FALSE_SIGMAS
    }

    /// Whether all four are called converged.
    pub fn all_converged(&self) -> bool {
        self.converged == [true; 4]
    }
}

/// A change or fault that was flagged.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Flagged {
    /// When, s.
    pub at_s: f64,
    /// A change or a fault.
    pub kind: ChangeKind,
    /// What it was put down to.
    pub cause: Cause,
}

/// What an unchanged robot's run ended with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClaimsOutcome {
    /// At 60, 120, 180 and 600 s, as far as the run went.
    pub snapshots: Vec<Snapshot>,
    /// Largest error in sigmas of a parameter called converged, at any time.
    pub worst_claim: f64,
    /// When all four were called converged for the first time, s.
    pub converged_s: Option<f64>,
    /// What was flagged although nothing had changed.
    pub flagged: Vec<Flagged>,
    /// Length of the run, s.
    pub length_s: f64,
}

/// What the run of a robot that changes ended with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChangeOutcome {
    /// When it changed, s.
    pub changed_s: f64,
    /// The four just before.
    pub before: Option<Snapshot>,
    /// What was flagged before.
    pub too_early: Vec<Flagged>,
    /// The first change that was flagged afterwards, and how far the robot had driven since, m.
    pub flag: Option<(Flagged, f64)>,
    /// Faults that were flagged afterwards.
    pub faults: Vec<Flagged>,
    /// Way driven after the change until the robot pointed 45° away from where it pointed then, m.
    // A run of before this was told is run again.
    #[serde(deserialize_with = "Option::deserialize")]
    pub turned_m: Option<f64>,
    /// Way driven after the change, m.
    pub driven_m: f64,
    /// Estimates told after the change, and how many of them held a false claim.
    pub told: [u32; 2],
    /// Estimates told later than 20 m after the change, and how many of them held a false claim.
    pub told_late: [u32; 2],
    /// The four at the end.
    pub end: Option<Snapshot>,
}

/// What a run ended with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Of an unchanged robot.
    Claims(ClaimsOutcome),
    /// Of a robot that changed.
    Change(Box<ChangeOutcome>),
}
