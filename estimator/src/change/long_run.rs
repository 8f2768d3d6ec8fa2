//! Do the data repeat what they say? The filter's claims against the scatter of disjoint blocks.
//!
//! On a real vehicle the errors of neighbouring windows are not independent: slip, play, load and
//! floor last for metres. Each block of some metres pulls the parameters its own way, by
//! `u = P J' S^-1 r`; if the noise were what the filter takes it for, `u` would have the covariance
//! `P J' S^-1 J P`. The ratio of the two, summed over the blocks, is how much larger a parameter's
//! variance really is (the sandwich estimator with clusters, of White and of Liang and Zeger). It
//! widens what is claimed and raises what a change has to show.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::window::Window;
use crate::filter::constraint::ByParameters;
use crate::filter::{PARAMETERS, ParameterCovariance, Values, apart};
use crate::stream::Stamp;

/// Windows in a block: errors that last longer than some 5 m are for the change test to judge.
const BLOCK: usize = 10;
/// Blocks that are remembered.
const MEMORY_BLOCKS: f64 = 60.0;
/// Fewest blocks, some 20 m, before the scatter is believed to be small.
const BLOCKS_MIN: f64 = 5.0;
/// The ratio until then: five times the standard deviation.
const UNPROVEN_RATIO: f64 = 25.0;
/// Share of the worst ratio that every parameter has at least: what lasts is seldom one's alone.
const SHARED: f64 = 0.5;
/// How much is added to an excess of scatter that is known from one block alone.
const DOUBT_BLOCKS: f64 = 6.0;
/// The first block is fitted as if it were the only one; its leverage is bounded as of so many.
const LEVERAGE_BLOCKS_MIN: f64 = 2.0;
/// Largest squared error of a block, in its variances: a fault is no noise.
const SQUARE_MAX: f64 = 400.0;

/// Windows without a gap between them, as one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Block {
    end: Stamp,
    residual: Vector3<f64>,
    jacobian: ByParameters,
    /// Of the motion, and of the pose at its beginning.
    covariance: Matrix3<f64>,
    windows: usize,
}

impl Block {
    fn begin(window: &Window, residual: Vector3<f64>) -> Self {
        Self {
            end: window.end,
            residual,
            jacobian: window.jacobian,
            covariance: window.covariance - window.end_covariance,
            windows: 1,
        }
    }

    /// The LiDAR pose between two windows is in both and cancels.
    fn extended(&self, window: &Window, residual: Vector3<f64>) -> Self {
        let carry = window.carry;
        Self {
            end: window.end,
            residual: carry * self.residual + residual,
            jacobian: carry * self.jacobian + window.jacobian,
            covariance: carry * self.covariance * carry.transpose() + window.motion_covariance,
            windows: self.windows + 1,
        }
    }
}

/// Learns how far the filter's claims are from what blocks of data repeat.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LongRunVariance {
    block: Option<Block>,
    /// Sum of `J' S^-1 r r' S^-1 J` over the blocks.
    scatter: SMatrix<f64, PARAMETERS, PARAMETERS>,
    /// Sum of `J' S^-1 J`: what the scatter should be.
    expected: SMatrix<f64, PARAMETERS, PARAMETERS>,
    blocks: f64,
}

impl LongRunVariance {
    /// Takes the next window, by the parameters as they are known now, its noise `scale` times as
    /// large as configured.
    pub fn push(&mut self, window: &Window, values: &Values, scale: f64) {
        let residual = window.residual + window.jacobian * apart(&window.values, values);
        let block = match self.block.take() {
            Some(before) if before.end == window.begin => before.extended(window, residual),
            _ => Block::begin(window, residual),
        };
        if block.windows < BLOCK {
            self.block = Some(block);
        } else {
            let covariance = (block.covariance + window.end_covariance) * scale;
            self.learn(&block, &covariance);
        }
    }

    fn learn(&mut self, block: &Block, covariance: &Matrix3<f64>) {
        let Some(factor) = covariance.cholesky() else {
            return;
        };
        let weighed = factor.solve(&block.residual);
        let square = block.residual.dot(&weighed);
        let score: SVector<f64, PARAMETERS> = block.jacobian.tr_mul(&weighed);
        let kept = 1.0 - 1.0 / MEMORY_BLOCKS;
        let weight = SQUARE_MAX / square.max(SQUARE_MAX) / (1.0 - self.leverage());
        self.scatter = self.scatter * kept + score * score.transpose() * weight;
        self.expected =
            self.expected * kept + block.jacobian.tr_mul(&factor.solve(&block.jacobian));
        self.blocks = self.blocks * kept + 1.0;
    }

    /// Share of the next block in the values that it is held against: they were fitted to it too,
    /// so that it scatters by so much less than it errs.
    fn leverage(&self) -> f64 {
        1.0 / (self.blocks + 1.0).max(LEVERAGE_BLOCKS_MIN)
    }

    /// What comes does not continue what was.
    pub fn break_block(&mut self) {
        self.block = None;
    }

    /// For each parameter, how many times larger its variance is than the filter's `covariance`
    /// says; at least 1.
    pub fn ratios(&self, covariance: &ParameterCovariance) -> Values {
        let seen = |sum: &SMatrix<f64, PARAMETERS, PARAMETERS>| {
            Values::from_fn(|i, _| covariance.column(i).dot(&(sum * covariance.column(i))))
        };
        let (scatter, expected) = (seen(&self.scatter), seen(&self.expected));
        let ratios = scatter.zip_map(&expected, |scatter, expected| {
            if expected > 0.0 {
                scatter / expected
            } else {
                1.0
            }
        });
        let least = (SHARED * ratios.max()).max(1.0);
        ratios.map(|ratio| ratio.max(least))
    }

    /// The same with the doubt of a scatter that is itself known from a few blocks only.
    pub fn doubtful_ratios(&self, covariance: &ParameterCovariance) -> Values {
        let doubt = 1.0 + DOUBT_BLOCKS / self.blocks.max(1.0);
        self.ratios(covariance)
            .map(|ratio| 1.0 + doubt * (ratio - 1.0))
    }

    /// The covariance that may be claimed when the filter has this one.
    pub fn claim(&self, covariance: &ParameterCovariance) -> ParameterCovariance {
        let least = if self.is_known() { 1.0 } else { UNPROVEN_RATIO };
        let widths = self
            .doubtful_ratios(covariance)
            .map(|ratio| ratio.max(least).sqrt());
        let widths = ParameterCovariance::from_diagonal(&widths);
        widths * covariance * widths
    }

    /// Whether enough blocks were seen.
    pub fn is_known(&self) -> bool {
        self.blocks > BLOCKS_MIN - 0.5
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::change::evidence::Evidence;
    use crate::change::window::{Innovation, Track};
    use crate::estimate::Parameter;

    /// Windows whose poses are exact and whose motion errs along the track as told.
    fn ratio(error: impl Fn(usize) -> f64) -> f64 {
        let mut variance = LongRunVariance::default();
        let covariance = Matrix3::identity();
        let x = Parameter::LidarX.index();
        let mut jacobian = ByParameters::zeros();
        jacobian[(0, x)] = 1.0;
        for i in 0..2000 {
            let residual = Vector3::new(error(i), 0.0, 0.0);
            let innovation = Innovation {
                residual,
                jacobian,
                covariance,
            };
            let window = Window {
                begin: Stamp(i as i64),
                end: Stamp(i as i64 + 1),
                residual,
                jacobian,
                covariance,
                carry: Matrix3::identity(),
                motion_covariance: covariance,
                end_covariance: Matrix3::zeros(),
                values: Values::zeros(),
                track: Track::default(),
                innovation,
                evidence: Evidence::of_window(&innovation).unwrap(),
            };
            variance.push(&window, &Values::zeros(), 1.0);
        }
        variance.ratios(&ParameterCovariance::identity())[x]
    }

    #[test]
    fn errors_that_alternate_do_not_add_up_and_those_that_last_do() {
        assert!(ratio(|i| if i % 2 == 0 { 1.0 } else { -1.0 }) < 1.05);
        assert!((ratio(|_| 1.0) - BLOCK as f64).abs() < 0.5);
    }

    #[test]
    fn nothing_is_claimed_before_data_have_repeated_it() {
        let claim = LongRunVariance::default().claim(&ParameterCovariance::identity());
        assert!((claim[(0, 0)] - UNPROVEN_RATIO).abs() < 1e-9);
    }
}
