//! Separates a calibration from what its filter took for the side slip of usual tyres.
//!
//! The prior of the slip is that of usual tyres, `N(0, s^2)`: all that the motion does not show of the slip is
//! taken from it, and at a steady speed that is all. The tyres of small cars give way ten times as far. So where two
//! calibrations of one vehicle are compared, each slip is drawn around that of the vehicle's own tyres,
//! `c ~ N(m, s^2)`, with an `m ~ N(0, (10 s)^2)` that both share.
//!
//! The mean of a Gaussian posterior with covariance `P` moves with the mean of its prior by `g = P e_c / s^2`,
//! so that values move by `g m`. The motion has shown `1 - g_c` of the slip: what was found
//! of it from the prior of usual tyres is `(1 - g_c) m`, with the variance `(1 - g_c) s^2`.

use super::{ParameterCovariance, SIDE_SLIP, Values};

/// Standard deviation of `m`, in units of the prior's.
const UNUSUAL: f64 = 10.0;

/// Slip in one calibration.
#[derive(Debug, Clone, Copy)]
pub struct Slip {
    found: f64,
    by_tyres: Values,
    shown: f64,
}

impl Slip {
    /// The slip in values with this covariance, of a filter whose prior has this standard deviation, rad for
    /// each m/s^2.
    pub fn of(values: &Values, covariance: &ParameterCovariance, prior_sigma: f64) -> Self {
        let variance = covariance[(SIDE_SLIP, SIDE_SLIP)];
        // A covariance that is widened for scatter may be wider than the prior.
        let prior_variance = variance.max(prior_sigma * prior_sigma);
        Self {
            found: values[SIDE_SLIP],
            by_tyres: covariance.column(SIDE_SLIP) / prior_variance,
            shown: 1.0 - variance / prior_variance,
        }
    }
}

/// Movement of the difference `new - stored` with the slip of the vehicle's tyres, as far as both show it, and
/// its covariance.
pub fn moved_by_tyres(
    stored: &Slip,
    new: &Slip,
    prior_sigma: f64,
) -> (Values, ParameterCovariance) {
    let by = new.by_tyres - stored.by_tyres;
    let weight = stored.shown + new.shown + UNUSUAL.powi(-2);
    let (mean, variance) = (
        (stored.found + new.found) / weight,
        prior_sigma * prior_sigma / weight,
    );
    (by * mean, by * by.transpose() * variance)
}
