//! The search for a change: a generalised likelihood ratio over onset and cause.
//!
//! Windows before and after an onset are evidence about the parameters, with the information
//! `I = sum J' S^-1 J` and `eta = sum J' S^-1 r`. If the parameters of a cause moved by `Delta` at
//! the onset, the score `s = eta_a - I_a p0` (at the common solution `p0`) has the information
//! `M = I_a - I_a (I_a + I_b)^-1 I_a`, and `s_c' (M_c + D^-1)^-1 s_c` is the log likelihood ratio
//! twice over, chi-squared with as many degrees of freedom as the cause has parameters. `D` is the
//! prior size of a change; it keeps out changes that the motion cannot show.
//!
//! Nothing stays quite as it was: over some metres slip or localisation move the apparent value of
//! a parameter by a `W` that no averaging removes. So the evidence for a change is how much better
//! `D` explains the score than `W` does, `s_c' (M_c + D^-1)^-1 s_c - s_c' (M_c + W^-1)^-1 s_c`;
//! with much information that is `Delta' (W^-1 - D^-1) Delta`, and small wander is never an alarm.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::evidence::{
    CAUSES, Evidence, HYPOTHESES, Information, Score, Thresholds, change_sigma, least_change,
    wander_sigma,
};
use super::window::Window;
use crate::estimate::Parameter;
use crate::filter::{PARAMETERS, ParameterCovariance, Values, apart};

/// Windows during which a change happens: they count on neither side of it. A LiDAR that is knocked
/// moves in the first, and its scan correction still believes that motion in the second.
pub const ONSET_WINDOWS: usize = 2;
/// Fewest windows after an onset.
pub const WINDOWS_AFTER_MIN: usize = 3;
/// Fewest windows before an onset.
const WINDOWS_BEFORE_MIN: usize = 2;
/// Number of the first parameters, among which are all that a cause can move.
const MOVABLE: usize = 5;

impl Evidence {
    pub(super) fn add(&mut self, term: &Term) {
        self.information += term.information;
        self.score += term.score;
        self.cost += term.cost;
    }

    /// Without the terms given.
    pub(super) fn without(&self, terms: &[Term]) -> Self {
        let mut rest = self.clone();
        for term in terms {
            rest.information -= term.information;
            rest.score -= term.score;
            rest.cost -= term.cost;
        }
        rest
    }
}

/// One window's evidence around the reference, clipped.
pub(super) struct Term<'a> {
    pub(super) information: &'a Information,
    pub(super) score: Score,
    cost: f64,
}

impl<'a> Term<'a> {
    /// `chi2_max` is in units of the noise as configured.
    fn new(window: &'a Window, reference: &Reference, chi2_max: f64) -> Self {
        let evidence = &window.evidence;
        let by = apart(&window.values, &reference.values);
        let shift = evidence.information * by;
        let cost = (evidence.cost + by.dot(&(2.0 * evidence.score + shift))).max(0.0);
        let shrink = if cost > chi2_max {
            (chi2_max / cost).sqrt()
        } else {
            1.0
        };
        Self {
            information: &evidence.information,
            score: (evidence.score + shift) * shrink,
            cost: cost * shrink * shrink,
        }
    }
}

/// The reference that windows are judged by: the parameters before them, with their uncertainty.
#[derive(Debug, Clone)]
pub struct Reference {
    /// Values.
    pub values: Values,
    /// Inverse of their covariance; parameters that are off are known exactly.
    pub(super) information: Information,
}

impl Reference {
    /// A reference; `None` when the covariance cannot be inverted.
    pub fn new(values: Values, covariance: &ParameterCovariance) -> Option<Self> {
        let mut regular = *covariance;
        for i in 0..PARAMETERS {
            // A parameter that is off has no variance; a nanounit stands for none.
            regular[(i, i)] += 1e-18;
        }
        Some(Self {
            values,
            information: regular.cholesky()?.inverse(),
        })
    }
}

/// The onset and cause that explain the windows best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accusation {
    /// Index of its hypothesis in [`HYPOTHESES`].
    pub hypothesis: usize,
    /// Index of the window in which it happened.
    pub onset: usize,
    /// Excess over its threshold.
    pub margin: f64,
    /// Squared residuals after the onset that it explains.
    explained: f64,
}

/// Evidence for a change in one window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Index of the window.
    pub onset: usize,
    /// Twice the log likelihood ratio of each of [`HYPOTHESES`].
    pub ratios: [f64; CAUSES],
    /// Squared residuals that each of them explains.
    explained: [f64; CAUSES],
    /// Squared residuals of the onset's own windows, which a change there explains.
    excluded: f64,
}

/// Parameters of the search of windows for a change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Search {
    /// Scale of the noise (as a variance, over that of the windows).
    pub noise_scale: f64,
    /// Squared length that one window may have; without a limit the question is what happened, with
    /// one it is whether anything did.
    pub window_chi2_max: f64,
    /// True if every onset is tried. Else they lie the wider the longer ago, a fifth apart: it is
    /// enough to detect that something happened.
    pub every_onset: bool,
}

/// The strongest accusation over all onsets and causes.
pub fn strongest(candidates: &[Candidate], thresholds: &Thresholds) -> Option<Accusation> {
    let mut best: Option<(f64, Accusation)> = None;
    for candidate in candidates {
        let ratios = candidate.ratios.iter().zip(&candidate.explained);
        let pairs = ratios.zip(thresholds.values());
        for (index, ((ratio, after), threshold)) in pairs.enumerate() {
            // All that it explains: what it removes after the onset, and the onset's own windows.
            let explained = after - threshold + candidate.excluded;
            if best.is_some_and(|(most, _)| explained <= most) {
                continue;
            }
            let accusation = Accusation {
                hypothesis: index,
                onset: candidate.onset,
                margin: ratio - threshold,
                explained: *after,
            };
            best = Some((explained, accusation));
        }
    }
    best.map(|(_, accusation)| accusation)
}

/// Evidence for a change at the onsets that have windows enough before and after them.
pub fn candidates<'a>(
    windows: impl Iterator<Item = &'a Window>,
    reference: &Reference,
    search: &Search,
) -> Vec<Candidate> {
    let scale = search.noise_scale;
    let (terms, all) = summed(windows, reference, search);
    let mut after = Evidence::zero();
    let mut due = WINDOWS_AFTER_MIN;
    let mut candidates = Vec::with_capacity(terms.len());
    for (first_after, term) in terms.iter().enumerate().rev() {
        after.add(term);
        let windows_after = terms.len() - first_after;
        let onset = first_after.saturating_sub(ONSET_WINDOWS);
        if onset < WINDOWS_BEFORE_MIN {
            break;
        }
        if windows_after < due {
            continue;
        }
        due = if search.every_onset {
            windows_after + 1
        } else {
            (windows_after + 1).max((6 * windows_after).div_ceil(5))
        };
        let own = terms.get(onset..first_after).unwrap_or_default();
        if let Some(compared) = compare(&all.without(own), &after, scale) {
            candidates.push(Candidate {
                onset,
                ratios: compared.map(|of_cause| of_cause.ratio / scale),
                explained: compared.map(|of_cause| of_cause.explained / scale),
                excluded: own.iter().map(|term| term.cost).sum::<f64>() / scale,
            });
        }
    }
    candidates
}

/// The windows' evidence, and all of it with the reference's: in units of the noise as configured, and the
/// reference's uncertainty with it.
pub(super) fn summed<'a>(
    windows: impl Iterator<Item = &'a Window>,
    reference: &Reference,
    search: &Search,
) -> (Vec<Term<'a>>, Evidence) {
    let scale = search.noise_scale;
    let terms: Vec<_> = windows
        .map(|window| Term::new(window, reference, search.window_chi2_max * scale))
        .collect();
    let mut all = Evidence::zero();
    for term in &terms {
        all.add(term);
    }
    all.information += reference.information * scale;
    (terms, all)
}

/// Mean squared whitened residual of the windows after an accusation's onset, per degree of
/// freedom, once the change is allowed for: near 1 when the cause explains the evidence.
pub fn misfit<'a>(
    windows: impl Iterator<Item = &'a Window>,
    reference: &Reference,
    search: &Search,
    accusation: &Accusation,
) -> Option<f64> {
    let (terms, all) = summed(windows, reference, search);
    let first_after = accusation.onset + ONSET_WINDOWS;
    let mut after = Evidence::zero();
    for term in terms.get(first_after..)? {
        after.add(term);
    }
    let both = all.without(terms.get(accusation.onset..first_after)?);
    // The parameters that fit before and after.
    let solution = both.information.cholesky()?.solve(&both.score);
    let by_solution = after.information * solution - 2.0 * after.score;
    let cost = (after.cost + solution.dot(&by_solution)) / search.noise_scale;
    let freed = HYPOTHESES
        .get(accusation.hypothesis)
        .map_or(0, |h| h.parameters.len());
    let freedom = (3 * (terms.len() - first_after) - freed).max(1) as f64;
    Some((cost - accusation.explained).max(0.0) / freedom)
}

/// Evidence that the smallest change which has to be seen would give for each cause if it had happened
/// in the middle of the windows: the least over the cause's parameters. Infinite where none is
/// promised, none while windows are too few.
pub fn expected_evidence<'a>(
    windows: impl ExactSizeIterator<Item = &'a Window>,
    reference: &Reference,
    scale: f64,
) -> [f64; CAUSES] {
    let middle = windows.len() / 2;
    let (mut before, mut after) = (reference.information * scale, Information::zeros());
    for (i, window) in windows.enumerate() {
        let sum = if i < middle { &mut before } else { &mut after };
        *sum += window.evidence.information;
    }
    let information = gained(&(before + after), &after);
    HYPOTHESES.each_ref().map(|hypothesis| {
        let Some(information) = information else {
            return 0.0;
        };
        let expected = hypothesis.parameters.iter().filter_map(|&parameter| {
            let score = information.column(parameter.index()) * least_change(parameter)?;
            let support = support_of(&score, &information, hypothesis.parameters, scale)?;
            Some(support.ratio / scale)
        });
        expected.fold(f64::INFINITY, f64::min)
    })
}

/// `I_a - I_a (I_a + I_b)^-1 I_a`, where a cause can move things.
fn gained(both: &Information, after: &Information) -> Option<SMatrix<f64, MOVABLE, MOVABLE>> {
    let columns = after.fixed_columns::<MOVABLE>(0);
    let mut half = columns.into_owned();
    both.cholesky()?
        .l_dirty()
        .solve_lower_triangular_mut(&mut half)
        .then_some(())?;
    Some(columns.fixed_rows::<MOVABLE>(0) - half.tr_mul(&half))
}

/// Evidence for a cause at one onset.
#[derive(Debug, Clone, Copy, Default)]
struct Support {
    /// Twice the log likelihood ratio against wander.
    ratio: f64,
    /// Squared residuals that a change of this cause explains.
    explained: f64,
}

/// Evidence for each cause at one onset; `both` is the windows' evidence before and after it.
fn compare(both: &Evidence, after: &Evidence, scale: f64) -> Option<[Support; CAUSES]> {
    // With both = L L', half = L^-1 I_a and forward = L^-1 eta:
    let common = both.information.cholesky()?;
    let factor = common.l_dirty();
    let columns = after.information.fixed_columns::<MOVABLE>(0);
    let (mut half, mut forward) = (columns.into_owned(), both.score);
    let is_regular = factor.solve_lower_triangular_mut(&mut half)
        && factor.solve_lower_triangular_mut(&mut forward);
    is_regular.then_some(())?;
    // s = eta_a - I_a (I_a + I_b)^-1 eta = eta_a - half' forward, and
    // I_a - I_a (I_a + I_b)^-1 I_a = I_a - half' half, where a cause can move things.
    let score = after.score.fixed_rows::<MOVABLE>(0) - half.tr_mul(&forward);
    let information = columns.fixed_rows::<MOVABLE>(0) - half.tr_mul(&half);
    let mut compared = [Support::default(); CAUSES];
    for (support, hypothesis) in compared.iter_mut().zip(&HYPOTHESES) {
        *support = support_of(&score, &information, hypothesis.parameters, scale)?;
    }
    Some(compared)
}

/// `s' (M + D^-1)^-1 s`, with and without `s' (M + W^-1)^-1 s`, over a cause's parameters, of which
/// there are three at most: places that are left over hold a one and no score.
fn support_of(
    score: &SVector<f64, MOVABLE>,
    information: &SMatrix<f64, MOVABLE, MOVABLE>,
    parameters: &[Parameter],
    scale: f64,
) -> Option<Support> {
    let mut part = Vector3::zeros();
    let (mut changed, mut wandered) = (Matrix3::identity(), Matrix3::identity());
    for (i, a) in parameters.iter().enumerate() {
        part[i] = score[a.index()];
        for (j, b) in parameters.iter().enumerate() {
            changed[(i, j)] = information[(a.index(), b.index())];
            wandered[(i, j)] = changed[(i, j)];
        }
        changed[(i, i)] += scale * change_sigma(*a).powi(-2);
        wandered[(i, i)] += scale * wander_sigma(*a).powi(-2);
    }
    let explained = part.dot(&changed.cholesky()?.solve(&part));
    let by_wander = part.dot(&wandered.cholesky()?.solve(&part));
    Some(Support {
        ratio: explained - by_wander,
        explained,
    })
}
