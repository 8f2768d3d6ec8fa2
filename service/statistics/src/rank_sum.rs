//! Rank-sum test of Wilcoxon, Mann and Whitney: whether two samples have one distribution. It
//! assumes no shape of it, and a wild value counts as one rank.

use crate::two_sided;

/// Bound of the probability that two samples of one distribution differ as much as these.
///
/// With `U` the number of pairs whose first value is the larger, `z = (|U - n m / 2| - 1/2) / s` with
/// `s^2 = n m (N + 1 - sum(t^3 - t) / (N (N - 1))) / 12` over ties of `t` values, `N = n + m`.
pub(crate) fn probability(first: &[f64], second: &[f64]) -> f64 {
    let (n, m) = (first.len() as f64, second.len() as f64);
    let all = n + m;
    // 1. Ranks in order; equal values share the mean of theirs.
    let of_first = first.iter().map(|value| (*value, true));
    let mut sorted: Vec<(f64, bool)> = of_first
        .chain(second.iter().map(|value| (*value, false)))
        .collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut below, mut ranks, mut tied) = (0.0, 0.0, 0.0);
    for tie in sorted.chunk_by(|a, b| a.0.total_cmp(&b.0).is_eq()) {
        let size = tie.len() as f64;
        let own = tie.iter().filter(|(_, is_first)| *is_first).count() as f64;
        ranks += own * (below + f64::midpoint(size, 1.0));
        tied += size.powi(3) - size;
        below += size;
    }
    // 2. Pairs whose first value is the larger, and their variance.
    let u = ranks - n * (n + 1.0) / 2.0;
    let variance = n * m * (all + 1.0 - tied / (all * (all - 1.0))) / 12.0;
    if variance.is_nan() || variance <= 0.0 {
        return 1.0;
    }
    // 3. Tail of the normal distribution, with the correction for continuity.
    two_sided(((u - n * m / 2.0).abs() - 0.5) / variance.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separate_samples_are_improbable_and_mixed_ones_are_not() {
        let low: Vec<f64> = (0..12).map(f64::from).collect();
        let high: Vec<f64> = (100..128).map(f64::from).collect();
        assert!(probability(&low, &high) < 1e-5);
        assert!((probability(&low, &high) - probability(&high, &low)).abs() < 1e-15);
        let mixed: Vec<f64> = (0..28).map(|one| f64::from(one) * 0.4).collect();
        assert!(probability(&low, &mixed) > 0.5);
        assert!(probability(&[1.0; 12], &[1.0; 28]) >= 1.0);
        assert!(probability(&[], &high) >= 1.0);
    }

    #[test]
    fn a_wild_value_counts_as_one() {
        let others: Vec<f64> = (0..28).map(f64::from).collect();
        let mut few: Vec<f64> = (8..20).map(f64::from).collect();
        few[0] = 1e12;
        assert!(probability(&few, &others) > 0.05);
    }
}
