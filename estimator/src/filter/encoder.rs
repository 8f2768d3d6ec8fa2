//! How far a speed that is measured beside the axle's middle may have moved the LiDAR's `y`.
//!
//! An encoder `y_e` beside the middle shifts `y_off` by `y_e`, and all that shows of it is a quadratic term
//! of the steering's curve, `-y_e / L`: no motion tells the two apart, and where they cancel nothing shows
//! at all. What is told instead is how probable that is. Most robots have no imperfection to speak of, or
//! one; a robot that shows several may well have these two as well. With the posterior `N(m, V)` of the
//! steering's imperfections under their priors, the evidence for *none*, for *one of them* and for *all of
//! them* is that of [`super::relevance`].

use nalgebra::{SMatrix, SVector};

use super::prior::{
    ASYMMETRY_SIGMA, CUBIC_SIGMA_PER_RAD2, QUADRATIC_SIGMA_PER_RAD, STEERING_LAG_SIGMA_S,
    STEERING_PLAY_SIGMA_RAD, STEERING_SPREAD_SIGMA_S2,
};
use super::relevance::{GAIN_SIGMA, Known, SHARE};
use super::{
    ASYMMETRY, CUBIC, Filter, QUADRATIC, STEERING_LAG, STEERING_PLAY, STEERING_SPREAD, Values,
};
use crate::estimate::Parameter;
use crate::vehicle::{SpeedMeasuredAt, Vehicle};

/// How far beside the axle's middle the speed may be measured where nobody said, one standard deviation, m.
const ENCODER_SIGMA_M: f64 = 0.05;
/// Share of a quadratic term that is seen which such an encoder may explain.
const ENCODER_SHARE: f64 = 0.4;
/// Number of the steering's parameters that are zero on a robot that obeys the model.
const TERMS: usize = 7;
/// Number of imperfections among them: lag and spread are one.
const IMPERFECTIONS: usize = 6;

/// A parameter that is zero, or one for the gain, on a robot without an imperfection.
struct Term {
    parameter: usize,
    /// Its prior's standard deviation.
    sigma: f64,
    /// Which imperfection it belongs to.
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

impl Known {
    /// Variance of the LiDAR's `y`, m², that no driving takes away from the filter that knows them, whose
    /// data scatter so many times more (as variances) than it says. A speed that is measured at the steered
    /// wheel, or beside the axle by a distance that is known, moves nothing.
    pub fn encoder_variance_m2(&self, filter: &Filter, vehicle: &Vehicle, scatter: &Values) -> f64 {
        if vehicle.speed_measured_at != SpeedMeasuredAt::RearAxle {
            return 0.0;
        }
        let square = self.quadratic_per_rad.powi(2) + self.covariance[(QUADRATIC, QUADRATIC)];
        let seen_m2 = (ENCODER_SHARE * vehicle.wheelbase_m).powi(2) * square;
        seen_m2.max(filter.hidden_encoder_m2(vehicle.wheelbase_m, scatter))
    }
}

impl Filter {
    /// Mean square of how far beside the axle's middle the speed may be measured on a robot with every
    /// imperfection, weighed with the probability that it is such a robot.
    fn hidden_encoder_m2(&self, wheelbase_m: f64, scatter: &Values) -> f64 {
        let covariance = self.parameter_covariance();
        let (encoder_m2, curve_m2) = (
            ENCODER_SIGMA_M.powi(2),
            (wheelbase_m * QUADRATIC_SIGMA_PER_RAD).powi(2),
        );
        let share = encoder_m2 / (encoder_m2 + curve_m2);
        let seen = self.values()[QUADRATIC].powi(2) + covariance[(QUADRATIC, QUADRATIC)];
        let square_m2 = share * curve_m2 + (share * wheelbase_m).powi(2) * seen;
        square_m2 * self.probability_of_every_imperfection(scatter)
    }

    fn probability_of_every_imperfection(&self, scatter: &Values) -> f64 {
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

    /// Twice the logarithm of how much more probable the data are where the terms chosen are a fifth of
    /// what their priors say. `None` where that cannot be told.
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
