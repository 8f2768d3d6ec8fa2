//! Evidence of windows of motion about the parameters, and the causes of a change that it
//! distinguishes.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::estimate::{Cause, Parameter};
use crate::filter::constraint::ByParameters;
use crate::filter::{PARAMETERS, Values};

/// Information on all parameters.
pub(super) type Information = SMatrix<f64, PARAMETERS, PARAMETERS>;
/// The score of all parameters.
pub(super) type Score = SVector<f64, PARAMETERS>;

/// [`Thresholds::window_chi2_max`] where errors are as large as assumed.
pub const WINDOW_CHI2_MAX: f64 = 16.0;
/// Windows in an hour of driving at 1 m/s.
pub const WINDOWS_PER_HOUR: f64 = 9000.0;
/// A cause: its parameters, and how its evidence behaves while nothing changes.
#[derive(Debug)]
pub struct Hypothesis {
    /// The cause.
    pub cause: Cause,
    /// The parameters that it moves, all among the first five.
    pub parameters: &'static [Parameter],
    /// Threshold for one false alarm in a single window, by the fit of `examples/false_alarms.rs`.
    pub threshold_at_one: f64,
    /// Gain of the threshold when the run between false alarms grows `e` times longer.
    pub threshold_per_log: f64,
}

/// Number of causes that are distinguished.
pub const CAUSES: usize = 3;

/// The causes that are distinguished.
pub const HYPOTHESES: [Hypothesis; CAUSES] = [
    Hypothesis {
        cause: Cause::Steering,
        parameters: &[Parameter::SteeringOffset],
        threshold_at_one: -1.6,
        threshold_per_log: 2.07,
    },
    Hypothesis {
        cause: Cause::LidarMount,
        parameters: &[Parameter::LidarX, Parameter::LidarY, Parameter::LidarYaw],
        threshold_at_one: 1.9,
        threshold_per_log: 2.21,
    },
    Hypothesis {
        cause: Cause::Vehicle,
        parameters: &[Parameter::SpeedScale],
        threshold_at_one: -1.6,
        threshold_per_log: 2.07,
    },
];

/// Twice the log likelihood ratios at which each of [`HYPOTHESES`] is believed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thresholds {
    of_causes: [f64; CAUSES],
    window_chi2_max: f64,
}

impl Thresholds {
    /// Thresholds with one false alarm in so many hours of driving, in equal shares of the causes.
    pub fn for_false_alarm_hours(hours: f64) -> Self {
        let windows = CAUSES as f64 * hours * WINDOWS_PER_HOUR;
        let log = windows.ln().max(0.0);
        Self {
            of_causes: HYPOTHESES
                .each_ref()
                .map(|hypothesis| hypothesis.threshold_at_one + hypothesis.threshold_per_log * log),
            window_chi2_max: WINDOW_CHI2_MAX,
        }
    }

    /// Thresholds where the errors of a cause's parameters are so many times as large (as
    /// variances) as assumed.
    #[must_use]
    pub fn raised(&self, ratios: &Values) -> Self {
        let mut raised = *self;
        let mut most = 1.0_f64;
        for (threshold, hypothesis) in raised.of_causes.iter_mut().zip(&HYPOTHESES) {
            let moved = hypothesis.parameters.iter().map(|p| ratios[p.index()]);
            let ratio = moved.fold(1.0, f64::max);
            *threshold *= ratio;
            most = most.max(ratio);
        }
        raised.window_chi2_max *= most;
        raised
    }

    /// Raised ones, with a limit of a single window that is at most so many times this one.
    #[must_use]
    pub fn limit_window(&self, raised: Self, ratio: f64) -> Self {
        Self {
            window_chi2_max: raised.window_chi2_max.min(self.window_chi2_max * ratio),
            ..raised
        }
    }

    /// The lowest of them.
    pub fn least(&self) -> f64 {
        self.of_causes.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// Thresholds in the order of [`HYPOTHESES`].
    pub fn values(&self) -> &[f64; CAUSES] {
        &self.of_causes
    }

    /// Largest squared length of a whitened residual that counts in full: one wild window alone can
    /// never reach a threshold.
    pub fn window_chi2_max(&self) -> f64 {
        self.window_chi2_max
    }
}

/// The smallest change of a parameter that has to be seen; `None` where none is promised.
pub fn least_change(parameter: Parameter) -> Option<f64> {
    match parameter {
        Parameter::SteeringOffset | Parameter::LidarYaw => Some(0.5f64.to_radians()),
        Parameter::LidarX | Parameter::LidarY => Some(0.02),
        _ => None,
    }
}

/// Prior of a parameter's motion in a change, one standard deviation.
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

/// Wander of a parameter while nothing changes, one standard deviation of the difference between
/// two stretches of some metres. A change of six of them is the smallest that is ever flagged: 0.05
/// degrees of steering, 0.07 of yaw, 2.5 mm.
pub fn wander_sigma(parameter: Parameter) -> f64 {
    match parameter {
        Parameter::SteeringOffset => 1.5e-4,
        Parameter::LidarYaw => 2e-4,
        Parameter::LidarX | Parameter::LidarY => 4e-4,
        Parameter::SpeedScale => 7e-4,
        Parameter::TimeOffset | Parameter::SteeringGain | Parameter::Wheelbase => 1e-3,
    }
}

/// A window's residual less its prediction by the windows before: they share a LiDAR pose, whose
/// error has one sign in the one and the other in the next. The rest is white.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation {
    /// Residual, by the window's own parameters.
    pub residual: Vector3<f64>,
    /// Derivatives of the residual by the parameters.
    pub jacobian: ByParameters,
    /// Its covariance.
    pub covariance: Matrix3<f64>,
}

/// Evidence of windows about the parameters, around one reference.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// `I`.
    pub(super) information: Information,
    /// `eta`, or the score around the reference.
    pub(super) score: Score,
    /// Sum of squared whitened residuals.
    pub(super) cost: f64,
}

impl Evidence {
    /// Evidence of no window.
    pub(super) fn zero() -> Self {
        Self {
            information: Information::zeros(),
            score: Score::zeros(),
            cost: 0.0,
        }
    }

    /// Evidence of one window, around its parameters; `None` when its covariance is singular.
    pub fn of_window(innovation: &Innovation) -> Option<Self> {
        let Innovation {
            residual,
            jacobian,
            covariance,
        } = innovation;
        let inverse = covariance.cholesky()?.inverse();
        let weighted = jacobian.transpose() * inverse;
        Some(Self {
            information: weighted * jacobian,
            score: weighted * residual,
            cost: residual.dot(&(inverse * residual)),
        })
    }
}
