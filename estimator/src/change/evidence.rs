//! Evidence for a change: a generalised likelihood ratio over onset and cause.
//!
//! Windows before and after an onset each say something about the parameters, as information
//! `I = sum J' S^-1 J` and `eta = sum J' S^-1 r`. If the parameters of a cause moved by `Delta` at
//! the onset, the score `s = eta_a - I_a p0` (at the common solution `p0`) has the information
//! `M = I_a - I_a (I_a + I_b)^-1 I_a`, and `s_c' (M_c + D^-1)^-1 s_c` is the log likelihood ratio
//! twice over, chi-squared with as many degrees of freedom as the cause has parameters. `D` is how
//! large a change may be; it keeps out what the motion cannot show.

use nalgebra::{DMatrix, DVector, SMatrix, SVector, Vector3};

use super::window::Window;
use crate::estimate::{Cause, Parameter};
use crate::filter::{PARAMETERS, ParameterCovariance, Values};

type Information = SMatrix<f64, PARAMETERS, PARAMETERS>;
type Score = SVector<f64, PARAMETERS>;

/// Largest squared length of a whitened residual that counts in full: one wild window alone can
/// never reach a threshold.
const WINDOW_CHI2_MAX: f64 = 16.0;
/// Windows that a change takes: they count on neither side of it. A LiDAR that is knocked moves in
/// the first, and its sweep correction still believes that motion in the second.
pub const ONSET_WINDOWS: usize = 2;
/// Fewest windows after an onset.
pub const WINDOWS_AFTER_MIN: usize = 3;
/// Fewest windows before an onset.
const WINDOWS_BEFORE_MIN: usize = 2;

/// A cause: its parameters, how far they may have moved, and its threshold.
pub struct Hypothesis {
    /// The cause.
    pub cause: Cause,
    /// The parameters that it moves.
    pub parameters: &'static [Parameter],
    /// Twice the log likelihood ratio at which it is believed.
    pub threshold: f64,
}

/// The causes that are told apart. The thresholds are those of `chi^2` with 1, 3 and 1 degrees of
/// freedom at the same tail probability, chosen for one false alarm in 10,000 robot-hours.
pub const HYPOTHESES: [Hypothesis; 3] = [
    Hypothesis {
        cause: Cause::Steering,
        parameters: &[Parameter::SteeringOffset],
        threshold: 40.0,
    },
    Hypothesis {
        cause: Cause::LidarMount,
        parameters: &[Parameter::LidarX, Parameter::LidarY, Parameter::LidarYaw],
        threshold: 46.0,
    },
    Hypothesis {
        cause: Cause::Vehicle,
        parameters: &[Parameter::SpeedScale],
        threshold: 40.0,
    },
];

/// How far a parameter may move in a change, one standard deviation.
pub fn change_sigma(parameter: Parameter) -> f64 {
    match parameter {
        Parameter::SteeringOffset
        | Parameter::LidarYaw
        | Parameter::LidarX
        | Parameter::LidarY
        | Parameter::TimeOffset => 0.05,
        Parameter::SpeedScale | Parameter::SteeringGain | Parameter::Wheelbase => 0.03,
    }
}

/// What windows say about the parameters, around one reference.
#[derive(Clone)]
struct Sum {
    information: Information,
    score: Score,
    /// Sum of squared whitened residuals.
    cost: f64,
}

impl Sum {
    fn zero() -> Self {
        Self {
            information: Information::zeros(),
            score: Score::zeros(),
            cost: 0.0,
        }
    }

    fn add(&mut self, term: &Self) {
        self.information += term.information;
        self.score += term.score;
        self.cost += term.cost;
    }

    fn remove(&mut self, term: &Self) {
        self.information -= term.information;
        self.score -= term.score;
        self.cost -= term.cost;
    }
}

/// The reference that windows are judged by: the parameters before them, with their doubt.
pub struct Reference {
    /// Values.
    pub values: Values,
    /// Inverse of their covariance; parameters that are off are known exactly.
    information: Information,
}

impl Reference {
    /// A reference; `None` when the covariance cannot be inverted.
    pub fn new(values: Values, covariance: &ParameterCovariance) -> Option<Self> {
        let mut regular = *covariance;
        for i in 0..PARAMETERS {
            // A parameter that is off has no variance; a nanounit stands for none.
            regular[(i, i)] += 1e-18;
        }
        Some(Self {
            values,
            information: regular.cholesky()?.inverse(),
        })
    }
}

/// The onset and cause that explain the windows best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accusation {
    /// Which of [`HYPOTHESES`].
    pub hypothesis: usize,
    /// Index of the window in which it happened.
    pub onset: usize,
    /// By how much its threshold is exceeded.
    pub margin: f64,
    /// The margin and the squared residuals of the onset's own windows: all that it explains.
    explained: f64,
    /// Mean squared whitened residual of the windows after the onset, per degree of freedom, once
    /// the change is allowed for: near 1 when the cause explains what is seen.
    pub misfit: f64,
}

fn term(window: &Window, reference: &Reference, noise_scale: f64, clipped: bool) -> Option<Sum> {
    let shifted: Vector3<f64> =
        window.residual + window.jacobian * (window.values - reference.values);
    let inverse = (window.covariance * noise_scale).cholesky()?.inverse();
    let weighted: SMatrix<f64, PARAMETERS, 3> = window.jacobian.transpose() * inverse;
    let information = weighted * window.jacobian;
    let length = shifted.dot(&(inverse * shifted));
    let shrink = if clipped && length > WINDOW_CHI2_MAX {
        (WINDOW_CHI2_MAX / length).sqrt()
    } else {
        1.0
    };
    Some(Sum {
        information,
        score: weighted * shifted * shrink,
        cost: length * shrink * shrink,
    })
}

fn terms<'a>(
    windows: impl Iterator<Item = &'a Window>,
    reference: &Reference,
    noise_scale: f64,
    clipped: bool,
) -> Option<Vec<Sum>> {
    windows
        .map(|window| term(window, reference, noise_scale, clipped))
        .collect()
}

/// The strongest accusation over all onsets and causes, by residuals that are clipped (to ask
/// whether anything happened) or in full (to ask what).
pub fn strongest<'a>(
    windows: impl Iterator<Item = &'a Window>,
    reference: &Reference,
    noise_scale: f64,
    clipped: bool,
) -> Option<Accusation> {
    let terms = terms(windows, reference, noise_scale, clipped)?;
    let mut before = Sum {
        information: reference.information,
        ..Sum::zero()
    };
    let mut after = Sum::zero();
    terms
        .iter()
        .skip(ONSET_WINDOWS)
        .for_each(|term| after.add(term));
    let mut best: Option<Accusation> = None;
    for (onset, term) in terms.iter().enumerate() {
        let windows_after = terms.len().saturating_sub(onset + ONSET_WINDOWS);
        if windows_after < WINDOWS_AFTER_MIN {
            break;
        }
        if onset >= WINDOWS_BEFORE_MIN {
            let excluded: f64 = terms
                .iter()
                .skip(onset)
                .take(ONSET_WINDOWS)
                .map(|term| term.cost)
                .sum();
            for mut accusation in accuse(&before, &after, onset, windows_after) {
                accusation.explained = accusation.margin + excluded;
                if best.is_none_or(|best| accusation.explained > best.explained) {
                    best = Some(accusation);
                }
            }
        }
        before.add(term);
        if let Some(next) = terms.get(onset + ONSET_WINDOWS) {
            after.remove(next);
        }
    }
    best
}

fn accuse(before: &Sum, after: &Sum, onset: usize, windows_after: usize) -> Vec<Accusation> {
    let Some(common) = (before.information + after.information).cholesky() else {
        return Vec::new();
    };
    let common_solution = common.solve(&(before.score + after.score));
    let score = after.score - after.information * common_solution;
    let information = after.information - after.information * common.solve(&after.information);
    // Squared residuals after the onset at the common solution.
    let cost_after = after.cost - 2.0 * after.score.dot(&common_solution)
        + common_solution.dot(&(after.information * common_solution));
    HYPOTHESES
        .iter()
        .enumerate()
        .filter_map(|(index, hypothesis)| {
            let ratio = likelihood_ratio(&score, &information, hypothesis.parameters)?;
            let freedom = (3 * windows_after - hypothesis.parameters.len()).max(1) as f64;
            Some(Accusation {
                hypothesis: index,
                onset,
                margin: ratio - hypothesis.threshold,
                explained: 0.0,
                misfit: (cost_after - ratio).max(0.0) / freedom,
            })
        })
        .collect()
}

fn likelihood_ratio(
    score: &Score,
    information: &Information,
    parameters: &[Parameter],
) -> Option<f64> {
    let size = parameters.len();
    let part = DVector::from_fn(size, |i, _| score[parameters[i].index()]);
    let block = DMatrix::from_fn(size, size, |i, j| {
        let prior = if i == j {
            change_sigma(parameters[i]).powi(-2)
        } else {
            0.0
        };
        information[(parameters[i].index(), parameters[j].index())] + prior
    });
    let solved = block.cholesky()?.solve(&part);
    Some(part.dot(&solved))
}
