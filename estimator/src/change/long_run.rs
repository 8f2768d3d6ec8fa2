//! How far windows of motion err together: the long-run variance of their whitened residuals.
//!
//! On a real vehicle the errors of neighbouring windows are not independent: play, load and floor
//! last for metres. A sum over `n` windows then errs by more than `sqrt(n)` windows would. The ratio
//! of the two, learnt from stretches some while ago, scales down the evidence for a change.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Windows in a block: errors that last longer than some 4 m are for the change test to judge.
const BLOCK: usize = 8;
/// Blocks over which the ratio is remembered.
const MEMORY_BLOCKS: f64 = 30.0;
/// Blocks' worth of belief in a ratio of 1 at the start.
const PRIOR_BLOCKS: f64 = 4.0;

/// Learns the ratio of long-run to window variance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LongRunVariance {
    sum: Vector3<f64>,
    in_block: usize,
    ratio: f64,
    blocks: f64,
}

impl Default for LongRunVariance {
    fn default() -> Self {
        Self {
            sum: Vector3::zeros(),
            in_block: 0,
            ratio: 1.0,
            blocks: PRIOR_BLOCKS,
        }
    }
}

impl LongRunVariance {
    /// Takes the whitened residual of the next window.
    pub fn push(&mut self, whitened: &Vector3<f64>) {
        self.sum += whitened;
        self.in_block += 1;
        if self.in_block < BLOCK {
            return;
        }
        let ratio = self.sum.norm_squared() / (3 * BLOCK) as f64;
        self.ratio += (ratio - self.ratio) / (self.blocks + 1.0);
        self.blocks = (self.blocks + 1.0).min(MEMORY_BLOCKS);
        self.sum = Vector3::zeros();
        self.in_block = 0;
    }

    /// The ratio, at least 1.
    pub fn ratio(&self) -> f64 {
        self.ratio.max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ratio(residual: impl Fn(usize) -> f64) -> f64 {
        let mut variance = LongRunVariance::default();
        for i in 0..800 {
            variance.push(&Vector3::repeat(residual(i)));
        }
        variance.ratio()
    }

    #[test]
    fn errors_that_alternate_do_not_add_up_and_those_that_last_do() {
        assert!(ratio(|i| if i % 2 == 0 { 1.0 } else { -1.0 }) < 1.05);
        assert!((ratio(|_| 1.0) - 8.0).abs() < 0.5);
    }
}
