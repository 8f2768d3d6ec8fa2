//! Posterior of a filter with as much of the steering's curve as its data need.
//!
//! Most steerings are straight. Asymmetry and quadratic term have wide priors all the same, and
//! where the motion does not distinguish them from the steering's zero (a figure-eight knows two
//! angles only), the zero is as open as they are. So each is assumed small, a share of its prior,
//! as long as the evidence of the data does not speak against it (automatic relevance
//! determination, with two choices).
//!
//! With the posterior `N(m, V)` of some under the prior `W`, the one under `S` adds the information
//! `A = S^-1 - W^-1`, and the data are more probable under `S` by
//! `ln |W|/|S| - ln |I + A V| - m' (A^-1 + V)^-1 m`, halved. Data that scatter more than by the
//! filter speak the less against `S`: the last term is divided by how much more.

use nalgebra::{SMatrix, SVector};

use super::prior::{ASYMMETRY_SIGMA, QUADRATIC_SIGMA_PER_RAD};
use super::{ASYMMETRY, Filter, PARAMETERS, ParameterCovariance, QUADRATIC, Values};
use crate::estimate::Parameter;

/// Largest excess of evidence (twice the logarithm) of the best explanation over one that is as
/// good.
const AS_GOOD: f64 = 6.0;
/// Discount of an explanation, as a share, where it is that much less probable: a term that passes
/// for 2.5 sigmas in the best explanation passes for 4 in one that is hardly as good.
const LESS_BEHIND: f64 = 0.375;
/// Share of its prior that a part has while it is small.
pub(crate) const SHARE: f64 = 0.2;
/// The default prior of the gain.
pub(crate) const GAIN_SIGMA: f64 = 0.02;
/// Number of parts that may be small.
const PARTS: usize = 3;

/// A parameter that may be small.
struct Part {
    parameter: usize,
    /// Its prior's standard deviation.
    sigma: f64,
}

/// The parts; the gain is small only to find whether a quadratic term explains as much.
const ALL: [Part; PARTS] = [
    part(ASYMMETRY, ASYMMETRY_SIGMA),
    part(QUADRATIC, QUADRATIC_SIGMA_PER_RAD),
    part(Parameter::SteeringGain.index(), GAIN_SIGMA),
];
/// Choices of small parts as the bits of a number; those below this leave the gain wide.
const CHOICES: usize = 1 << PARTS;
const CHOICES_OF_WIDE_GAIN: usize = CHOICES / 2;

type Parts = SMatrix<f64, PARTS, PARTS>;

const fn part(parameter: usize, sigma: f64) -> Part {
    Part { parameter, sigma }
}

impl Part {
    /// `A^-1`.
    fn inverse_information(&self) -> f64 {
        (SHARE * self.sigma).powi(2) / (1.0 - SHARE * SHARE)
    }

    /// `ln W/S - ln A`.
    fn prior_evidence(&self) -> f64 {
        (self.sigma * self.sigma / (1.0 - SHARE * SHARE)).ln()
    }
}

/// Knowledge of the parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Known {
    /// Values.
    pub values: Values,
    /// Their covariance.
    pub covariance: ParameterCovariance,
    /// Square of the quadratic term, or the largest one in an explanation that is as good, 1/rad².
    pub(crate) largest_quadratic_square: f64,
}

/// The parts of one choice: their `A^-1 + V` and means, the places of the others holding a one and a
/// zero.
struct Choice {
    innovation: Parts,
    mean: SVector<f64, PARTS>,
    evidence: f64,
}

impl Filter {
    /// Values and covariance of the parameters, with as much of the steering's imperfections as the
    /// data need, which scatter so many times more (as variances) than by the filter.
    pub fn known(&self, scatter: &Values) -> Known {
        let all = Known {
            values: *self.values(),
            covariance: self.parameter_covariance(),
            largest_quadratic_square: self.values()[QUADRATIC].powi(2),
        };
        let mut evidences = [f64::NEG_INFINITY; CHOICES];
        for (choice, evidence) in evidences.iter_mut().enumerate() {
            *evidence = all
                .choose(choice, scatter)
                .map_or(*evidence, |c| c.evidence);
        }
        // Where the data do not tell, as few as can be.
        let wide_gain = evidences.iter().take(CHOICES_OF_WIDE_GAIN).enumerate();
        let best = wide_gain.max_by(|a, b| a.1.total_cmp(b.1));
        let (choice, most) = best.map_or((0, 0.0), |(choice, evidence)| (choice, *evidence));
        let Some(mut known) = all.with_small(choice, scatter) else {
            return all;
        };
        for (choice, evidence) in evidences.iter().enumerate() {
            let behind = (most - evidence).max(0.0) / AS_GOOD;
            if behind >= 1.0 {
                continue;
            }
            let quadratic = all.quadratic_with_small(choice, scatter).unwrap_or(0.0);
            let counted = ((1.0 - LESS_BEHIND * behind) * quadratic).powi(2);
            known.largest_quadratic_square = known.largest_quadratic_square.max(counted);
        }
        known
    }
}

impl Known {
    /// `None` where a part that would be small is none of the filter's.
    fn choose(&self, choice: usize, scatter: &Values) -> Option<Choice> {
        let mut innovation = Parts::identity();
        let mut mean = SVector::<f64, PARTS>::zeros();
        let (mut evidence, mut most_scatter) = (0.0, 1.0_f64);
        let is_small = |i: usize| choice >> i & 1 == 1;
        for (i, part) in ALL.iter().enumerate().filter(|(i, _)| is_small(*i)) {
            if self.covariance[(part.parameter, part.parameter)] <= 0.0 {
                return None;
            }
            for (j, other) in ALL.iter().enumerate().filter(|(j, _)| is_small(*j)) {
                innovation[(i, j)] = self.covariance[(part.parameter, other.parameter)];
            }
            innovation[(i, i)] += part.inverse_information();
            mean[i] = self.values[part.parameter];
            if part.parameter == Parameter::SteeringGain.index() {
                mean[i] -= 1.0;
            }
            evidence += part.prior_evidence();
            most_scatter = most_scatter.max(scatter[part.parameter]);
        }
        let factor = innovation.cholesky()?;
        evidence -= factor.determinant().ln() + mean.dot(&factor.solve(&mean)) / most_scatter;
        Some(Choice {
            innovation,
            mean,
            evidence,
        })
    }

    /// The quadratic term of [`Self::with_small`].
    fn quadratic_with_small(&self, choice: usize, scatter: &Values) -> Option<f64> {
        let Choice {
            innovation, mean, ..
        } = self.choose(choice, scatter)?;
        let mut cross = SVector::<f64, PARTS>::zeros();
        for (i, part) in ALL.iter().enumerate().filter(|(i, _)| choice >> i & 1 == 1) {
            cross[i] = self.covariance[(QUADRATIC, part.parameter)];
        }
        let pulled = cross.dot(&innovation.cholesky()?.solve(&mean));
        Some(self.values[QUADRATIC] - pulled)
    }

    fn with_small(&self, choice: usize, scatter: &Values) -> Option<Self> {
        let Choice {
            innovation, mean, ..
        } = self.choose(choice, scatter)?;
        let mut cross = SMatrix::<f64, PARAMETERS, PARTS>::zeros();
        for (i, part) in ALL.iter().enumerate().filter(|(i, _)| choice >> i & 1 == 1) {
            cross.set_column(i, &self.covariance.column(part.parameter));
        }
        let gain = cross * innovation.cholesky()?.inverse();
        let covariance = self.covariance - gain * cross.transpose();
        let values = self.values - gain * mean;
        Some(Self {
            values,
            covariance: (covariance + covariance.transpose()) * 0.5,
            largest_quadratic_square: values[QUADRATIC].powi(2),
        })
    }
}
