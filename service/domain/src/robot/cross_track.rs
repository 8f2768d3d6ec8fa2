//! Cross-track error of a robot with one calibration.

use serde::{Deserialize, Serialize};

/// Width of a bin, m.
pub const BIN_WIDTH_M: f64 = 0.01;
/// Bins to either side of the path. Errors beyond them count in the outermost ones.
pub const BINS_PER_SIDE: usize = 50;
/// Most calibrations of a robot whose histograms are kept.
pub const GENERATIONS_MAX: usize = 8;

/// Cross-track errors of one robot with one calibration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CrossTrack {
    /// Number of errors.
    pub count: u64,
    /// Sum of the errors, m.
    pub sum_m: f64,
    /// Sum of their squares, m^2.
    pub sum_square_m2: f64,
    /// Number of bends: errors minus the mean of the two a second before and after.
    #[serde(default)]
    pub bends: u64,
    /// Sum of the squares of the bends, m^2.
    #[serde(default)]
    pub sum_square_bend_m2: f64,
    /// Number of errors in each bin, from far right of the path to far left.
    pub bins: Vec<u64>,
}

impl Default for CrossTrack {
    fn default() -> Self {
        Self {
            count: 0,
            sum_m: 0.0,
            sum_square_m2: 0.0,
            bends: 0,
            sum_square_bend_m2: 0.0,
            bins: vec![0; 2 * BINS_PER_SIDE],
        }
    }
}

impl CrossTrack {
    /// Adds one error, m, positive when left of the path.
    pub fn add(&mut self, error_m: f64) {
        self.count += 1;
        self.sum_m += error_m;
        self.sum_square_m2 += error_m * error_m;
        let bin = (error_m / BIN_WIDTH_M).floor() + BINS_PER_SIDE as f64;
        let last = self.bins.len().saturating_sub(1);
        let bin = (bin.max(0.0) as usize).min(last);
        if let Some(count) = self.bins.get_mut(bin) {
            *count += 1;
        }
    }

    /// Adds the bend of three errors a second apart, m.
    pub fn add_bend(&mut self, [before_m, error_m, after_m]: [f64; 3]) {
        let bend_m = error_m - 0.5 * (before_m + after_m);
        self.bends += 1;
        self.sum_square_bend_m2 += bend_m * bend_m;
    }

    /// Variance of the part that changes from one second to the next, m^2; `None` without bends.
    ///
    /// Independent errors of variance `s` make bends of the mean square `s + 2 s / 4`; errors that
    /// last for seconds make none.
    pub fn brief_m2(&self) -> Option<f64> {
        (self.bends > 0).then(|| self.sum_square_bend_m2 / (1.5 * self.bends as f64))
    }

    /// Root mean square, m.
    pub fn rms_m(&self) -> f64 {
        (self.sum_square_m2 / self.count.max(1) as f64).sqrt()
    }

    /// Mean, m.
    pub fn mean_m(&self) -> f64 {
        self.sum_m / self.count.max(1) as f64
    }
}
