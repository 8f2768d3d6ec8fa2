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
    // 1. Number of pairs; equal values count half.
    let pairs = first.iter().map(|a| {
        let of_pair = second.iter().map(|b| match a.total_cmp(b) {
            std::cmp::Ordering::Greater => 1.0,
            std::cmp::Ordering::Equal => 0.5,
            std::cmp::Ordering::Less => 0.0,
        });
        of_pair.sum::<f64>()
    });
    let u: f64 = pairs.sum();
    // 2. Its variance, less what ties take.
    let mut sorted: Vec<f64> = first.iter().chain(second).copied().collect();
    sorted.sort_by(f64::total_cmp);
    let ties = sorted.chunk_by(|a, b| a.total_cmp(b).is_eq());
    let tied: f64 = ties
        .map(|tie| (tie.len() as f64).powi(3) - tie.len() as f64)
        .sum();
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
