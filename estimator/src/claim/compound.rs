//! Probability that a robot has every imperfection of its steering at once.
//!
//! Most robots have no imperfection to speak of, or one; a robot that shows several may well have those
//! that cannot be seen, too. With the posterior `N(m, V)` of the steering's imperfections under their
//! priors, the evidence for *none*, for *one of them* and for *all of them* is that of
//! [`crate::filter::relevance`].

use nalgebra::{SMatrix, SVector};

use crate::estimate::Parameter;
use crate::filter::prior::{
    ASYMMETRY_SIGMA, CUBIC_SIGMA_PER_RAD2, QUADRATIC_SIGMA_PER_RAD, STEERING_LAG_SIGMA_S,
    STEERING_PLAY_SIGMA_RAD, STEERING_SPREAD_SIGMA_S2,
};
use crate::filter::relevance::{GAIN_SIGMA, SHARE};
use crate::filter::{
    ASYMMETRY, CUBIC, Filter, QUADRATIC, STEERING_LAG, STEERING_PLAY, STEERING_SPREAD, Values,
};

/// Excess in error of imperfections together over their sum: behind a lag the wheel takes up its
/// play later than the sensor, and stands between the encoder's steps. On two-sided routes that
/// cancels. 600 simulated robots with every typical imperfection on a loop of left turns had
/// steering zeros off by 0.041 degrees (root mean square) where the filter's sigma is 0.032
/// degrees; this, in quadrature, is the missing part, rad.
const ZERO_SIGMA_RAD: f64 = 0.000_44;
/// Same error where the turns went to one side, which cancels nothing: there the errors have long
/// tails, and with less 2 of 600 such robots claimed a zero that was off by 0.15 degrees, rad
/// (0.035 degrees).
const ONE_SIDED_ZERO_SIGMA_RAD: f64 = 0.000_61;
/// Same error of a filter that began while the robot drove, as well: only a start distinguishes the
/// delay of the wheels' messages from the lag of the steering. Of 48 such robots on a loop of left
/// turns, whose filters began again on the way, four claimed a zero that was off by 0.21 to 0.25
/// degrees; all were off by 0.074 degrees (root mean square), those that began at rest by 0.041,
/// rad (0.061 degrees).
const UNSEEN_START_ZERO_SIGMA_RAD: f64 = 0.001_07;
/// Number of the steering's parameters that are zero on a robot that obeys the model.
const TERMS: usize = 7;
/// Number of imperfections among them: lag and spread are one.
const IMPERFECTIONS: usize = 6;

/// A parameter that is zero, or one for the gain, on a robot without an imperfection.
struct Term {
    parameter: usize,
    /// Its prior's standard deviation.
    sigma: f64,
    /// Number of the imperfection it belongs to.
    imperfection: usize,
}

const fn term(parameter: usize, sigma: f64, imperfection: usize) -> Term {
    Term {
        parameter,
        sigma,
        imperfection,
    }
}

const ALL: [Term; TERMS] = [
    term(Parameter::SteeringGain.index(), GAIN_SIGMA, 0),
    term(ASYMMETRY, ASYMMETRY_SIGMA, 1),
    term(QUADRATIC, QUADRATIC_SIGMA_PER_RAD, 2),
    term(CUBIC, CUBIC_SIGMA_PER_RAD2, 3),
    term(STEERING_LAG, STEERING_LAG_SIGMA_S, 4),
    term(STEERING_SPREAD, STEERING_SPREAD_SIGMA_S2, 4),
    term(STEERING_PLAY, STEERING_PLAY_SIGMA_RAD, 5),
];

impl Filter {
    /// Part of the variance of the steering's zero that no driving removes, rad², on a robot that
    /// has every imperfection with this probability, whose turns went to one side alone so far (0
    /// to 1), and which the filter saw start from rest, or not.
    pub fn compound_zero_variance_rad2(
        probability: f64,
        one_sidedness: f64,
        saw_start: bool,
    ) -> f64 {
        let both = ZERO_SIGMA_RAD.powi(2);
        let mut one = ONE_SIDED_ZERO_SIGMA_RAD.powi(2);
        if !saw_start {
            one += UNSEEN_START_ZERO_SIGMA_RAD.powi(2);
        }
        probability * (both + one_sidedness * (one - both))
    }

    /// The probability that the robot has every imperfection, where its data scatter so many times
    /// more (as variances) than by the filter.
    pub fn probability_of_every_imperfection(&self, scatter: &Values) -> f64 {
        let against = |small: &dyn Fn(&Term) -> bool| {
            self.evidence_for_small(small, scatter)
                .map_or(0.0, |twice_log| (0.5 * twice_log).exp())
        };
        let none = against(&|_| true);
        let one: f64 = (0..IMPERFECTIONS)
            .map(|only| against(&|term: &Term| term.imperfection != only))
            .sum();
        1.0 / (1.0 + none + one / IMPERFECTIONS as f64)
    }

    /// Twice the logarithm of how much more probable the data are where the chosen terms are a
    /// fifth of their priors. `None` where that cannot be computed.
    fn evidence_for_small(
        &self,
        is_small: &dyn Fn(&Term) -> bool,
        scatter: &Values,
    ) -> Option<f64> {
        let covariance = self.parameter_covariance();
        let mut innovation = SMatrix::<f64, TERMS, TERMS>::identity();
        let mut mean = SVector::<f64, TERMS>::zeros();
        let mut evidence = 0.0;
        // A term that is none of the filter's tells nothing.
        let is_chosen =
            |term: &Term| is_small(term) && covariance[(term.parameter, term.parameter)] > 0.0;
        // By scatter no term is known worse than by its prior.
        let wider = |term: &Term| {
            let variance = covariance[(term.parameter, term.parameter)];
            let most = (term.sigma.powi(2) / variance).max(1.0);
            scatter[term.parameter].min(most).sqrt()
        };
        for (i, term) in ALL.iter().enumerate().filter(|(_, term)| is_chosen(term)) {
            for (j, other) in ALL.iter().enumerate().filter(|(_, term)| is_chosen(term)) {
                let joint = covariance[(term.parameter, other.parameter)];
                innovation[(i, j)] = joint * wider(term) * wider(other);
            }
            let wide = term.sigma.powi(2) / (1.0 - SHARE * SHARE);
            innovation[(i, i)] += SHARE * SHARE * wide;
            evidence += wide.ln();
            mean[i] = self.values()[term.parameter];
            if term.parameter == Parameter::SteeringGain.index() {
                mean[i] -= 1.0;
            }
        }
        let factor = innovation.cholesky()?;
        Some(evidence - factor.determinant().ln() - mean.dot(&factor.solve(&mean)))
    }
}
