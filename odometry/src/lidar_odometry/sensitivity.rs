//! Sensitivity of an aligned scan's residuals to the scanner's systematic errors.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::beam_filter::{Block, LANES};
use super::local_motion::LocalMotion;
use super::point_to_line::{Alignment, Laid, Matches, sum_of_lanes};

/// Stride of the evaluated blocks of points: the unknowns stay, so that any scan shows them.
const ASKED_STRIDE: usize = 2;
/// Derivatives of a residual: by the three unknowns, then by pose and velocity.
const COLUMNS: usize = 9;
/// Products of an unknown's derivative with all of them, and with the residual.
const TERMS: usize = 3 * (COLUMNS + 1);

/// Evidence of an aligned scan's residuals `r` on the scanner's three unknowns, whose derivatives
/// of `r` are `D` (by duration, range bias and bias by incidence); `J` are those by pose and
/// velocity.
#[derive(Debug, Clone, Copy)]
pub struct ScannerEquations {
    /// `D'WD`.
    pub information: Matrix3<f64>,
    /// `D'WJ`.
    pub with_motion: SMatrix<f64, 3, 6>,
    /// `-D'Wr`.
    pub gradient: Vector3<f64>,
}

impl Alignment<'_> {
    /// Sums the weighted products of the derivatives over every other block. `phase` picks the
    /// blocks, so that over time all are evaluated.
    pub fn ask_scanner(&self, motion: &LocalMotion, phase: usize) -> ScannerEquations {
        let mut totals = [0.0; TERMS];
        let blocks = self.points.blocks().iter();
        for block in blocks.skip(phase % ASKED_STRIDE).step_by(ASKED_STRIDE) {
            let mut matches = Matches::NONE;
            let laid = self.lay(motion, block, &mut matches);
            let terms = self.products(motion, block, &laid);
            for (total, lanes) in totals.iter_mut().zip(&terms) {
                *total += f64::from(sum_of_lanes(lanes));
            }
        }
        // The blocks left out would have said the same.
        let at = |row: usize, column: usize| {
            let total = totals.get(row * (COLUMNS + 1) + column);
            ASKED_STRIDE as f64 * total.copied().unwrap_or_default()
        };
        ScannerEquations {
            information: Matrix3::from_fn(at),
            with_motion: SMatrix::from_fn(|row, column| at(row, 3 + column)),
            gradient: Vector3::from_fn(|row, _| -at(row, COLUMNS)),
        }
    }

    /// The products of a block, lane by lane.
    fn products(&self, motion: &LocalMotion, block: &Block, laid: &Laid) -> [[f32; LANES]; TERMS] {
        let mut terms = [[0.0; LANES]; TERMS];
        let (vx, vy, omega) = motion.velocity();
        for i in 0..LANES {
            let seen = self.seen(motion, block, laid, i);
            let (jx, jy, jt) = (seen.jx, seen.jy, seen.jt);
            let (cos, mapped) = (seen.cos, laid.cos[i]);
            let by_incidence = |cos: f32| cos * (1.0 - cos.abs());
            let tau = block.tau_s[i];
            // Across its line a beam taken at the part s of the scan moves by s (v + omega x q).
            let by = [
                block.phase[i] * (jx * vx + jy * vy + jt * omega),
                mapped - cos,
                by_incidence(mapped) - by_incidence(cos),
                jx,
                jy,
                jt,
                tau * jx,
                tau * jy,
                tau * jt,
                seen.distance,
            ];
            let [duration, bias, incidence, ..] = by.map(|derivative| seen.weight * derivative);
            let rows = terms.chunks_exact_mut(COLUMNS + 1);
            for (row, weighted) in rows.zip([duration, bias, incidence]) {
                for (lanes, derivative) in row.iter_mut().zip(by) {
                    lanes[i] = weighted * derivative;
                }
            }
        }
        terms
    }
}
