//! Terms of a published sigma: why it is as wide as it is.

use serde::{Deserialize, Serialize};

/// Reason for a part of a published sigma.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum SigmaSource {
    /// Uncertainty before the first metre.
    Prior,
    /// Covariance of the filter.
    Filter,
    /// Covariance of the stored calibration, while a new session is not yet held against it.
    Stored,
    /// Scatter of the data: disjoint blocks of some metres repeat each other worse than the filter expects.
    Scatter,
    /// Scatter known from few blocks only, and for the speed scale slip that outlasts a block.
    FewBlocks,
    /// Speed measured beside the axle's middle, at a distance that is not configured.
    SpeedPlace,
    /// Rear wheels of unequal size.
    UnequalWheels,
    /// Turns to one side alone, which do not tell a drift of the tyres from the LiDAR's yaw.
    Circling,
    /// Steps of a steering encoder that does not tremble on straights.
    EncoderSteps,
    /// Play of the steering: the side on which the wheel stands is inferred, not measured.
    Play,
    /// Lag, play and encoder steps together, by the probability that the robot has all of them.
    Compound,
    /// Step that recent windows suggest beyond chance, and that is not certain enough to be flagged as a change.
    Contradicted,
    /// Variances that no driving shows, as they were when the calibration was stored.
    Undriven,
    /// Systematic error that averaging does not remove, from the configuration.
    Systematic,
    /// Scale of the LiDAR's ranges.
    RangeScale,
}

/// Effect of a term on the sigma of the terms before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum SigmaEffect {
    /// Adds an independent error: squares add up.
    Adds,
    /// Multiplies it.
    Multiplies,
}

/// One term of a published sigma. The terms applied in their order, from 0, give the sigma.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SigmaTerm {
    /// Its reason.
    pub source: SigmaSource,
    /// Its effect.
    pub effect: SigmaEffect,
    /// Standard deviation in the parameter's unit where it adds, a factor where it multiplies.
    pub size: f64,
}

impl SigmaTerm {
    /// The sigma with this term, from the one of all terms before it.
    #[must_use]
    pub fn applied_to(&self, sigma: f64) -> f64 {
        match self.effect {
            SigmaEffect::Adds => sigma.hypot(self.size),
            SigmaEffect::Multiplies => sigma * self.size,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terms_apply_in_their_order() {
        let term = |effect, size| SigmaTerm {
            source: SigmaSource::Filter,
            effect,
            size,
        };
        let terms = [
            term(SigmaEffect::Adds, 1.5),
            term(SigmaEffect::Multiplies, 2.0),
            term(SigmaEffect::Adds, 4.0),
        ];
        let sigma = terms.iter().fold(0.0, |sigma, term| term.applied_to(sigma));
        assert!((sigma - 5.0).abs() < 1e-12);
    }
}
