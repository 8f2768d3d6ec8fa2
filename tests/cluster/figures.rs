//! Figures of a number of rounds: quantiles, and the bound on an event that was not seen.

/// Returns the exact upper bound, with 95 % confidence, of the probability of an event that was
/// observed in `seen` of `rounds` independent rounds (Clopper and Pearson 1934, one-sided). Without
/// any it is `1 - 0.05^(1/n)`, about `3/n`.
pub fn bound_95(seen: u64, rounds: u64) -> f64 {
    if seen >= rounds {
        return 1.0;
    }
    // The number seen or fewer is as probable as 5 % at the bound; that falls as the probability grows.
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..100 {
        let middle = f64::midpoint(low, high);
        if at_most(seen, rounds, middle) > 0.05 {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

/// Returns the probability of `seen` or fewer of `rounds`, each of probability `p`.
fn at_most(seen: u64, rounds: u64, p: f64) -> f64 {
    let mut logarithm = rounds as f64 * (1.0 - p).ln();
    let mut sum = logarithm.exp();
    for k in 1..=seen {
        logarithm += ((rounds - k + 1) as f64 / k as f64).ln() + p.ln() - (1.0 - p).ln();
        sum += logarithm.exp();
    }
    sum
}

/// Formats a count of undesired events for a report.
pub fn told(seen: u64, rounds: u64) -> String {
    let bound = bound_95(seen, rounds) * 100.0;
    format!("{seen} of {rounds} (95 %: at most {bound:.2} %)")
}

/// Returns the value that a share `q` of the values does not exceed (nearest rank); 0 without
/// values.
pub fn quantile(values: &[f64], q: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let rank = (q * sorted.len() as f64).ceil() as usize;
    let at = rank.clamp(1, sorted.len().max(1)) - 1;
    sorted.get(at).copied().unwrap_or_default()
}

/// Formats median, 99th percentile and maximum, s.
pub fn spread(values: &[f64]) -> String {
    let [median, p99, max] = [0.5, 0.99, 1.0].map(|q| quantile(values, q));
    let count = values.len();
    format!("median {median:.2} s, p99 {p99:.2} s, max {max:.2} s (N = {count})")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares with tables of the Clopper–Pearson interval: 0 of 100 is at most 2.951 %, 1 of 50
    /// at most 9.140 %.
    #[test]
    fn the_bound_is_that_of_the_tables() {
        for (seen, rounds, expected) in [(0, 100, 0.029_51), (1, 50, 0.091_40), (0, 1, 0.95)] {
            let bound = bound_95(seen, rounds);
            assert!(
                (bound - expected).abs() < 5e-5,
                "{seen} of {rounds}: {bound}"
            );
        }
        assert!((bound_95(3, 3) - 1.0).abs() < 1e-12);
        let rule_of_three = 3.0 / 2_000.0;
        assert!((bound_95(0, 2_000) - rule_of_three).abs() < 5e-6);
    }

    #[test]
    fn quantiles_are_of_the_nearest_rank() {
        let values: Vec<f64> = (1..=50).map(f64::from).collect();
        let found = [0.5, 0.99, 1.0].map(|q| quantile(&values, q) as u32);
        assert_eq!(found, [25, 50, 50]);
        assert!(quantile(&[], 0.5).abs() < 1e-12);
    }
}
