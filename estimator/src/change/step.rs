//! Suspected steps: their sizes by the windows around an onset, and their uncertainty by the scatter of
//! these windows.
//!
//! The windows before and after an onset are fitted by common parameters `p` and a step `Delta` of one
//! cause's parameters `c`. With `K = (I_a + I_b)^-1 I_a,c` and the covariance `B` of the step, the rest of a
//! block of windows, `u = J' S^-1 (r - J p - J_c Delta)`, pulls the step by `B (u_c - K' u)`, where `u_c` counts
//! after the onset alone. The squares of the pulls of all blocks are the step's variance (the sandwich
//! estimator with clusters). The step is no part of this scatter, and no value has to be `converged`.

use nalgebra::{DMatrix, DVector};

use super::evidence::{Evidence, HYPOTHESES, Hypothesis, Information, change_sigma};
use super::search::{Candidate, ONSET_WINDOWS, Reference, Search, Term, summed};
use super::window::Window;
use crate::filter::{PARAMETERS, Values};

/// Windows in a block, some 2 m: the windows of the search make a dozen blocks.
const BLOCK: usize = 5;
/// Square of a step, in its variances, up to which it is chance where the scatter is known: three sigmas.
const CHANCE: f64 = 9.0;
/// Degrees of freedom of the blocks that a step and its onset take.
const FITTED: f64 = 2.0;

/// Squares of the steps of each parameter that the windows suggest beyond chance, at the onset with the most
/// evidence for each cause; zero where they suggest none.
pub fn suspected<'a>(
    windows: impl Iterator<Item = &'a Window>,
    reference: &Reference,
    search: &Search,
    candidates: &[Candidate],
) -> Values {
    let mut squares = Values::zeros();
    let onsets: Vec<_> = HYPOTHESES
        .iter()
        .enumerate()
        .filter_map(|(cause, hypothesis)| {
            let ratio = |candidate: &&Candidate| candidate.ratios[cause];
            let best = candidates
                .iter()
                .max_by(|a, b| ratio(a).total_cmp(&ratio(b)));
            let best = best.filter(|candidate| ratio(candidate) > CHANCE)?;
            Some((hypothesis, best.onset))
        })
        .collect();
    if onsets.is_empty() {
        return squares;
    }
    let (terms, all) = summed(windows, reference, search);
    for (hypothesis, onset) in onsets {
        let split = Split {
            terms: &terms,
            onset,
            moved: hypothesis.parameters.iter().map(|p| p.index()).collect(),
            scale: search.noise_scale,
        };
        let found = split.beyond_chance(&all, &reference.information, hypothesis);
        squares = squares.sup(&found.unwrap_or_default());
    }
    squares
}

/// Windows that an onset splits, and the parameters that moved there.
struct Split<'a> {
    terms: &'a [Term<'a>],
    onset: usize,
    moved: Vec<usize>,
    /// Scale of the noise (as a variance, over the configured one).
    scale: f64,
}

/// Parameters that fit the windows before an onset, and after it.
struct Fit {
    before: Values,
    after: Values,
    /// `B`, in units of the noise as configured.
    covariance: DMatrix<f64>,
    /// `K`.
    gain: DMatrix<f64>,
}

impl Split<'_> {
    fn first_after(&self) -> usize {
        self.onset + ONSET_WINDOWS
    }

    fn of_moved(&self, score: &Values) -> DVector<f64> {
        DVector::from_fn(self.moved.len(), |i, _| score[self.moved[i]])
    }

    /// Squares of the step, less chance.
    fn beyond_chance(
        &self,
        all: &Evidence,
        reference: &Information,
        hypothesis: &Hypothesis,
    ) -> Option<Values> {
        let fit = self.fit(all, hypothesis)?;
        let (scatter, blocks) = self.scatter(&fit)?;
        let by_reference = &fit.gain * &fit.covariance;
        let of_reference = by_reference.tr_mul(&(reference * &by_reference)) * self.scale.powi(2);
        // Of few blocks chance is Student's: `t^2 = n (exp(z^2 / n) - 1)`.
        let freedom = (blocks - FITTED).max(1.0);
        let chance = freedom * (CHANCE / freedom).exp_m1();
        let mut squares = Values::zeros();
        for (i, moved) in self.moved.iter().enumerate() {
            let least = fit.covariance[(i, i)] * self.scale;
            let variance = scatter[i] * blocks / freedom + of_reference[(i, i)];
            let step = fit.after[*moved] - fit.before[*moved];
            squares[*moved] = (step * step - chance * variance.max(least)).max(0.0);
        }
        Some(squares)
    }

    fn fit(&self, all: &Evidence, hypothesis: &Hypothesis) -> Option<Fit> {
        let mut after = Evidence::zero();
        for term in self.terms.get(self.first_after()..)? {
            after.add(term);
        }
        let both = all.without(self.terms.get(self.onset..self.first_after())?);
        let factor = both.information.cholesky()?;
        let columns = DMatrix::from_fn(PARAMETERS, self.moved.len(), |i, j| {
            after.information[(i, self.moved[j])]
        });
        let gain = factor.solve(&columns);
        let mut information = columns.select_rows(&self.moved) - columns.tr_mul(&gain);
        for (i, parameter) in hypothesis.parameters.iter().enumerate() {
            information[(i, i)] += self.scale * change_sigma(*parameter).powi(-2);
        }
        let covariance = information.cholesky()?.inverse();
        let step = &covariance * (self.of_moved(&after.score) - gain.tr_mul(&both.score));
        let before: Values = factor.solve(&(both.score - &columns * &step));
        let mut with_step = before;
        for (by, moved) in step.iter().zip(&self.moved) {
            with_step[*moved] += by;
        }
        Some(Fit {
            before,
            after: with_step,
            covariance,
            gain,
        })
    }

    /// Sum of the squared pulls of the blocks on the step, and the number of blocks.
    fn scatter(&self, fit: &Fit) -> Option<(DVector<f64>, f64)> {
        let (mut squares, mut blocks) = (DVector::zeros(self.moved.len()), 0.0);
        let before = (self.terms.get(..self.onset)?, &fit.before, false);
        let after = (self.terms.get(self.first_after()..)?, &fit.after, true);
        for (terms, values, has_step) in [before, after] {
            for block in terms.chunks(BLOCK) {
                let rest = block.iter().fold(Values::zeros(), |sum, term| {
                    sum + term.score - term.information * values
                });
                let own = if has_step {
                    self.of_moved(&rest)
                } else {
                    DVector::zeros(self.moved.len())
                };
                let pull = &fit.covariance * (own - fit.gain.tr_mul(&rest));
                squares += pull.component_mul(&pull);
                blocks += 1.0;
            }
        }
        Some((squares, blocks))
    }
}
