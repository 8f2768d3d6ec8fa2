//! Claims: the values that may be published, and for each sigma the list of its terms.
//!
//! The filter's covariance holds for a robot that obeys the model. Everything that makes a published sigma
//! wider is a term here, with its reason, formula and source; the published sigma is that list folded.
//! Factors come first, then the variances of errors that no driving shows, added up before they join the
//! covariance, then the standard deviations that stand in the published sigma alone. The reasons for which a
//! value with a small sigma is withheld all the same are those of [`withheld::Withheld`].

mod compound;
pub mod encoder;
mod steering_table;
pub mod withheld;

use encoder::EncoderVariance;

use crate::change::long_run::{LongRunVariance, widened};
use crate::drive_history::DriveHistory;
use crate::estimate::{
    CalibrationCovariance, Estimate, Parameter, ParameterEstimates, SigmaEffect, SigmaSource,
    SigmaTerm,
};
use crate::excitation::Excitation;
use crate::filter::relevance::Known;
use crate::filter::{Filter, ParameterCovariance, STEERING_PLAY, Values};
use crate::settings::EstimatorSettings;
use crate::vehicle::Vehicle;

/// Share of half the play by which the steering's zero may be off: which side of it the wheel stands on is
/// known by where it was sent to, not by where it went.
const PLAY_SHARE: f64 = 0.1;
/// Sigma of the angle by which the body of a vehicle that only circles may point away from where
/// its rear axle rolls, rad (0.25 degrees): tyres drift, and no circle distinguishes that from the
/// LiDAR's yaw. A real car that turned right for 142 s claimed a yaw that was 0.87 degrees off.
const CIRCLING_YAW_SIGMA_RAD: f64 = 0.004_4;
/// Standard deviation of the scale of a LiDAR's ranges, typical by docs/assumptions.md.
const RANGE_SCALE_SIGMA: f64 = 0.005;

/// Effect of one term on all parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Widening {
    /// Factors of the errors, 1 where the term has no part.
    Factors(Values),
    /// Variances of errors that no driving shows.
    Variances(Values),
    /// Standard deviations that the published sigma has beside the covariance.
    Beside(Values),
}

/// One reason why sigmas are wider than the covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Term {
    source: SigmaSource,
    widening: Widening,
}

/// Data beside the filter that its claim depends on.
#[derive(Debug, Clone, Copy)]
pub struct Grounds<'a> {
    /// The vehicle.
    pub vehicle: &'a Vehicle,
    /// The settings, for the systematic sigmas.
    pub settings: &'a EstimatorSettings,
    /// Scatter of the data.
    pub long_run: &'a LongRunVariance,
    /// Recent drive samples, for the steps of the steering encoder.
    pub drive: &'a DriveHistory,
    /// Motion of the session so far.
    pub excitation: &'a Excitation,
    /// True if the filter saw the robot start from rest.
    pub saw_start: bool,
    /// Squares of the steps that recent windows suggest beyond chance.
    pub suspicion: &'a Values,
}

/// Values that may be published, with the terms of their sigmas.
#[derive(Debug, Clone, PartialEq)]
pub struct Claim {
    values: Values,
    /// Source of the covariance that is widened.
    source: SigmaSource,
    known: ParameterCovariance,
    terms: Vec<Term>,
    covariance: ParameterCovariance,
    encoder_variance: EncoderVariance,
}

impl Claim {
    /// A claim of values by their covariance alone, from this source.
    pub fn new(
        source: SigmaSource,
        values: Values,
        covariance: &ParameterCovariance,
        settings: &EstimatorSettings,
    ) -> Self {
        let none = EncoderVariance::default();
        Self::folded(source, (values, covariance), Vec::new(), none, settings)
    }

    /// The claim of a stored calibration: its covariance with the variances that no driving showed then.
    pub fn of_stored(
        values: Values,
        covariance: &ParameterCovariance,
        undriven: Values,
        settings: &EstimatorSettings,
    ) -> Self {
        let terms = vec![Term {
            source: SigmaSource::Undriven,
            widening: Widening::Variances(undriven),
        }];
        let encoder_variance = EncoderVariance::undriven(undriven[Parameter::LidarY.index()]);
        let known = (values, covariance);
        Self::folded(
            SigmaSource::Stored,
            known,
            terms,
            encoder_variance,
            settings,
        )
    }

    /// The claim of a filter.
    pub fn of_filter(filter: &Filter, grounds: &Grounds) -> Self {
        let covariance = filter.parameter_covariance();
        let scatter = grounds.long_run.scatter(&covariance);
        let known = filter.known(scatter.ratios());
        let of_known = grounds.long_run.scatter(&known.covariance);
        let every_imperfection = filter.probability_of_every_imperfection(scatter.ratios());
        let factors = |source, factors| Term {
            source,
            widening: Widening::Factors(factors),
        };
        let mut terms = vec![
            factors(SigmaSource::Scatter, of_known.claim_widths()),
            factors(SigmaSource::FewBlocks, of_known.publish_widths()),
        ];
        // What the curve of the steering hides depends on how well the curve is known, scatter included.
        let scattered = Known {
            covariance: fold(&known.covariance, &terms),
            ..known
        };
        let encoder = scattered.encoder_variance(filter, grounds.vehicle, every_imperfection);
        terms.extend(hidden(&known, &encoder, every_imperfection, grounds));
        terms.push(Term {
            source: SigmaSource::Contradicted,
            widening: Widening::Variances(*grounds.suspicion),
        });
        Self::folded(
            SigmaSource::Filter,
            (known.values, &known.covariance),
            terms,
            encoder,
            grounds.settings,
        )
    }

    /// Folds the terms over a covariance, and adds those that every claim has.
    fn folded(
        source: SigmaSource,
        (values, known): (Values, &ParameterCovariance),
        mut terms: Vec<Term>,
        encoder_variance: EncoderVariance,
        settings: &EstimatorSettings,
    ) -> Self {
        let covariance = fold(known, &terms);
        terms.push(systematic(&covariance, settings));
        terms.push(range_scale(&values));
        Self {
            values,
            source,
            known: *known,
            terms,
            covariance,
            encoder_variance,
        }
    }

    /// The values.
    pub fn values(&self) -> &Values {
        &self.values
    }

    /// Covariance of the parameters, without the terms that stand in the published sigma alone.
    pub fn covariance(&self) -> &ParameterCovariance {
        &self.covariance
    }

    /// Part of the LiDAR's `y` variance that covers a speed measured elsewhere than assumed.
    pub fn encoder_variance(&self) -> &EncoderVariance {
        &self.encoder_variance
    }

    /// Variance that a source adds to a parameter, in its unit squared.
    pub fn variance_of(&self, source: SigmaSource, parameter: Parameter) -> f64 {
        let of_source = self.terms.iter().filter(|term| term.source == source);
        of_source
            .map(|term| match term.widening {
                Widening::Variances(variances) => variances[parameter.index()],
                Widening::Factors(_) | Widening::Beside(_) => 0.0,
            })
            .sum()
    }

    /// Sigma that is published of a parameter, in its unit: all terms folded.
    pub fn sigma(&self, parameter: Parameter) -> f64 {
        self.sigma_of(parameter, |_| true)
    }

    /// Sigma that a status is judged by: the published one without the scale of the LiDAR's ranges.
    /// No driving shows that, so that no parameter waits for it.
    pub fn judged_sigma(&self, parameter: Parameter) -> f64 {
        self.sigma_of(parameter, |source| source != SigmaSource::RangeScale)
    }

    fn sigma_of(&self, parameter: Parameter, has: impl Fn(SigmaSource) -> bool) -> f64 {
        let i = parameter.index();
        let variance = self.covariance[(i, i)];
        let sigma = if variance <= 0.0 {
            0.0
        } else {
            variance.sqrt()
        };
        let terms = self.terms.iter().filter(|term| has(term.source));
        terms.fold(sigma, |sigma, term| match term.widening {
            Widening::Beside(more) => sigma.hypot(more[i]),
            // These are in the covariance.
            Widening::Factors(_) | Widening::Variances(_) => sigma,
        })
    }

    /// Terms of a parameter's published sigma that have a part in it, in their order.
    pub fn sigma_terms(&self, parameter: Parameter) -> Vec<SigmaTerm> {
        let i = parameter.index();
        let known = SigmaTerm {
            source: self.source,
            effect: SigmaEffect::Adds,
            size: self.known[(i, i)].max(0.0).sqrt(),
        };
        let widened = self.terms.iter().map(|term| {
            let (effect, size) = match term.widening {
                Widening::Factors(factors) => (SigmaEffect::Multiplies, factors[i]),
                Widening::Variances(variances) => (SigmaEffect::Adds, variances[i].sqrt()),
                Widening::Beside(sigmas) => (SigmaEffect::Adds, sigmas[i]),
            };
            SigmaTerm {
                source: term.source,
                effect,
                size,
            }
        });
        let has_part = |term: &SigmaTerm| match term.effect {
            SigmaEffect::Adds => term.size > 0.0,
            SigmaEffect::Multiplies => term.size > 1.0,
        };
        std::iter::once(known)
            .chain(widened)
            .filter(has_part)
            .collect()
    }
}

/// Errors of a filter that no driving shows, on a robot that has every imperfection with this probability.
fn hidden(
    known: &Known,
    encoder: &EncoderVariance,
    every_imperfection: f64,
    grounds: &Grounds,
) -> [Term; 6] {
    let (drive, driven) = (grounds.drive, grounds.excitation);
    let [offset, y, yaw] = [
        Parameter::SteeringOffset,
        Parameter::LidarY,
        Parameter::LidarYaw,
    ];
    let straight_rad = known.values[offset.index()];
    let unequal_wheels_m2 = encoder.unequal_wheels_sigma_m.powi(2);
    let circling_rad2 = CIRCLING_YAW_SIGMA_RAD.powi(2) * driven.circling();
    let steps_rad2 = drive.repeated_reading_variance_rad2(straight_rad);
    let play_rad2 = (PLAY_SHARE * known.values[STEERING_PLAY]).powi(2);
    let compound_rad2 = Filter::compound_zero_variance_rad2(
        every_imperfection,
        driven.one_sidedness(),
        grounds.saw_start,
    );
    [
        variance(SigmaSource::SpeedPlace, y, encoder.place_m2),
        variance(SigmaSource::UnequalWheels, y, unequal_wheels_m2),
        variance(SigmaSource::Circling, yaw, circling_rad2),
        variance(SigmaSource::EncoderSteps, offset, steps_rad2),
        variance(SigmaSource::Play, offset, play_rad2),
        variance(SigmaSource::Compound, offset, compound_rad2),
    ]
}

/// Variance of one parameter, from a source.
fn variance(source: SigmaSource, parameter: Parameter, variance: f64) -> Term {
    let mut variances = Values::zeros();
    variances[parameter.index()] = variance;
    Term {
        source,
        widening: Widening::Variances(variances),
    }
}

/// The covariance with its terms: factors in their order, then the sum of the variances.
fn fold(known: &ParameterCovariance, terms: &[Term]) -> ParameterCovariance {
    let mut covariance = *known;
    let mut hidden = Values::zeros();
    for term in terms {
        match &term.widening {
            Widening::Factors(factors) => covariance = widened(&covariance, factors),
            Widening::Variances(variances) => hidden += variances,
            Widening::Beside(_) => {}
        }
    }
    for (i, variance) in hidden.iter().enumerate() {
        covariance[(i, i)] += variance;
    }
    covariance
}

/// Configured errors that averaging does not remove, of each parameter that has an error at all.
fn systematic(covariance: &ParameterCovariance, settings: &EstimatorSettings) -> Term {
    let mut sigmas = Values::zeros();
    for parameter in Parameter::ALL {
        let i = parameter.index();
        if covariance[(i, i)] > 0.0 {
            sigmas[i] = *settings.systematic_sigma.get(parameter);
        }
    }
    Term {
        source: SigmaSource::Systematic,
        widening: Widening::Beside(sigmas),
    }
}

/// Term of the scale of the LiDAR's ranges, which passes for that of the speed on the straight, and
/// stretches the mount in turns.
fn range_scale(values: &Values) -> Term {
    let mut sigmas = Values::zeros();
    for parameter in Parameter::ALL {
        let i = parameter.index();
        sigmas[i] = scale_sigma(parameter, values[i]);
    }
    Term {
        source: SigmaSource::RangeScale,
        widening: Widening::Beside(sigmas),
    }
}

fn scale_sigma(parameter: Parameter, value: f64) -> f64 {
    match parameter {
        Parameter::LidarX | Parameter::LidarY => RANGE_SCALE_SIGMA * value.abs(),
        _ => 0.0,
    }
}

/// An estimate for a comparison with values that the same LiDAR has measured. The scale of its
/// ranges (1 sigma: 0.5 % of the mount's x and y, m) is off alike in both, and no part of their
/// difference.
#[must_use]
pub fn without_range_scale(mut estimate: Estimate) -> Estimate {
    for parameter in [Parameter::LidarX, Parameter::LidarY] {
        let one = &mut estimate.parameters[parameter.index()];
        let scale_sigma = scale_sigma(parameter, one.value);
        let variance = (one.sigma * one.sigma - scale_sigma * scale_sigma).max(0.0);
        one.sigma = variance.sqrt();
    }
    let told = estimate.covariance;
    estimate.covariance = CalibrationCovariance::from_fn(|row, column| {
        if row == column {
            estimate.parameters[row.index()].sigma.powi(2)
        } else {
            told.rows()[row.index()][column.index()]
        }
    });
    estimate
}

/// The covariance that leaves the estimator: the errors as they go together, with each parameter's
/// reported sigma.
pub fn reported_covariance(
    parameters: &ParameterEstimates,
    covariance: &ParameterCovariance,
) -> CalibrationCovariance {
    CalibrationCovariance::from_fn(|row, column| {
        let [sigma, other] = [row, column].map(|p| parameters[p.index()].sigma);
        if row == column {
            sigma * sigma
        } else if sigma > 0.0 && other > 0.0 {
            covariance[(row.index(), column.index())]
        } else {
            // A parameter that is off has no error.
            0.0
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn factors(source: SigmaSource, factor: f64) -> Term {
        Term {
            source,
            widening: Widening::Factors(Values::repeat(factor)),
        }
    }

    /// A claim of a LiDAR's `y` with a term of each kind.
    fn claim() -> Claim {
        let y = Parameter::LidarY;
        let mut values = Values::zeros();
        values[y.index()] = 0.1;
        let terms = vec![
            factors(SigmaSource::Scatter, 1.5),
            variance(SigmaSource::SpeedPlace, y, 4e-8),
            variance(SigmaSource::UnequalWheels, y, 9e-8),
        ];
        let covariance = ParameterCovariance::identity() * 1e-8;
        let settings = EstimatorSettings::default();
        let known = (values, &covariance);
        let none = EncoderVariance::default();
        Claim::folded(SigmaSource::Filter, known, terms, none, &settings)
    }

    #[test]
    fn the_terms_of_a_sigma_give_it() {
        let claim = claim();
        for parameter in Parameter::ALL {
            let terms = claim.sigma_terms(parameter);
            let folded = terms.iter().fold(0.0, |sigma, term| term.applied_to(sigma));
            assert!((folded - claim.sigma(parameter)).abs() < 1e-12 * folded);
        }
        let sources: Vec<_> = claim
            .sigma_terms(Parameter::LidarY)
            .iter()
            .map(|term| term.source)
            .collect();
        let expected = [
            SigmaSource::Filter,
            SigmaSource::Scatter,
            SigmaSource::SpeedPlace,
            SigmaSource::UnequalWheels,
            SigmaSource::Systematic,
            SigmaSource::RangeScale,
        ];
        assert_eq!(sources, expected);
    }

    #[test]
    fn no_parameter_waits_for_the_scale_of_ranges() {
        let claim = claim();
        let [judged, published] = [
            claim.judged_sigma(Parameter::LidarY),
            claim.sigma(Parameter::LidarY),
        ];
        assert!((judged.hypot(0.1 * RANGE_SCALE_SIGMA) - published).abs() < 1e-15);
        let offset = Parameter::SteeringOffset;
        assert!((claim.judged_sigma(offset) - claim.sigma(offset)).abs() < 1e-18);
    }

    #[test]
    fn a_parameter_without_error_has_no_systematic_one() {
        let covariance = ParameterCovariance::zeros();
        let settings = EstimatorSettings::default();
        let claim = Claim::new(SigmaSource::Prior, Values::zeros(), &covariance, &settings);
        for parameter in Parameter::ALL {
            assert!(claim.sigma(parameter) <= 0.0);
            assert!(claim.sigma_terms(parameter).is_empty());
        }
    }
}
