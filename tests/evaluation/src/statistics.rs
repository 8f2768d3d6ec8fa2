//! Means, spreads, and what a count proves.

use std::fmt;

/// Returns the root of the mean square.
pub fn rms(values: &[f64]) -> f64 {
    let squares: f64 = values.iter().map(|value| value * value).sum();
    (squares / values.len().max(1) as f64).sqrt()
}

/// Returns the mean.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Returns the standard deviation of a sample.
pub fn spread(values: &[f64]) -> f64 {
    let middle = mean(values);
    let squares: f64 = values.iter().map(|value| (value - middle).powi(2)).sum();
    (squares / (values.len().max(2) - 1) as f64).sqrt()
}

/// Returns the largest absolute value.
pub fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most, value| most.max(value.abs()))
}

/// Returns the value below which `share` of the absolute values lie.
pub fn quantile_of_size(values: &[f64], share: f64) -> f64 {
    let mut sizes: Vec<_> = values.iter().map(|value| value.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let place = (share * sizes.len().saturating_sub(1) as f64).round() as usize;
    sizes.get(place).copied().unwrap_or_default()
}

/// A count among cases, with its bound.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Proportion {
    /// Counted cases.
    pub count: u64,
    /// All cases.
    pub of: u64,
}

impl Proportion {
    /// Counts the cases that satisfy `counted`.
    pub fn count<T>(all: impl Iterator<Item = T>, counted: impl Fn(&T) -> bool) -> Self {
        all.fold(Self::default(), |so_far, one| Self {
            count: so_far.count + u64::from(counted(&one)),
            of: so_far.of + 1,
        })
    }

    /// Returns the share; 0 without cases.
    pub fn share(&self) -> f64 {
        self.count as f64 / self.of.max(1) as f64
    }

    /// Returns the upper end of the exact one-sided interval of 95 % (Clopper and Pearson 1934):
    /// the probability at which this count or a lower one is observed in 5 % of cases. For 0 of N
    /// it is about 3/N.
    pub fn upper_bound(&self) -> f64 {
        if self.count >= self.of {
            return 1.0;
        }
        bisect(1.0, |probability| self.at_most(probability))
    }

    /// Returns the probability of at most this count, `sum over i of C(n, i) p^i (1 - p)^(n - i)`.
    fn at_most(&self, probability: f64) -> f64 {
        let odds = probability / (1.0 - probability);
        let mut term = self.of as f64 * (-probability).ln_1p();
        let mut sum = term.exp();
        for i in 0..self.count {
            term += ((self.of - i) as f64 / (i + 1) as f64 * odds).ln();
            sum += term.exp();
        }
        sum
    }
}

impl fmt::Display for Proportion {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        let bound = 100.0 * self.upper_bound();
        write!(out, "{}/{} (≤{bound:.2}%)", self.count, self.of)
    }
}

/// A count over hours, with its bound.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Rate {
    /// Counted events.
    pub count: u64,
    /// Hours of driving.
    pub hours: f64,
}

impl Rate {
    /// Returns the number in one hour; 0 in no time.
    pub fn an_hour(&self) -> f64 {
        if self.hours > 0.0 {
            self.count as f64 / self.hours
        } else {
            0.0
        }
    }

    /// Returns the upper end of the exact one-sided interval of 95 % for the number in one hour:
    /// for 0 in T hours about 3/T.
    pub fn upper_bound(&self) -> f64 {
        let most = 20.0 + 3.0 * self.count as f64;
        bisect(most, |expected| self.at_most(expected)) / self.hours
    }

    /// Returns the probability of at most this count if `expected` is the mean, by Poisson's law.
    fn at_most(&self, expected: f64) -> f64 {
        let mut term = -expected;
        let mut sum = term.exp();
        for i in 0..self.count {
            term += (expected / (i + 1) as f64).ln();
            sum += term.exp();
        }
        sum
    }
}

impl fmt::Display for Rate {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        let bound = self.upper_bound();
        write!(out, "{} in {:.1} h (≤{bound:.3}/h)", self.count, self.hours)
    }
}

/// Returns the place where a falling probability passes 5 %, between 0 and `most`.
fn bisect(most: f64, probability: impl Fn(f64) -> f64) -> f64 {
    const UNLIKELY: f64 = 0.05;
    let (mut low, mut high) = (0.0, most);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if probability(middle) > UNLIKELY {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_three_numbers() {
        let values = [1.0, -2.0, 3.0];
        assert!((rms(&values) - (14.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!((mean(&values) - 2.0 / 3.0).abs() < 1e-12);
        assert!((spread(&values) - 6.333_333_333_333_333_f64.sqrt()).abs() < 1e-12);
        assert!((largest(&values) - 3.0).abs() < 1e-12);
        assert!((quantile_of_size(&values, 0.5) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn bounds_are_those_of_clopper_and_pearson() {
        let bound = |count, of| Proportion { count, of }.upper_bound();
        // Reference: the root of sum C(n, i) p^i (1 - p)^(n - i) = 0.05, with whole binomials.
        for (count, of, expected) in [
            (0, 1, 0.95),
            (0, 600, 0.004_980_5),
            (1, 20, 0.216_106),
            (3, 600, 0.012_871_6),
            (17, 18, 0.997_154),
            (5, 5, 1.0),
        ] {
            let seen = bound(count, of);
            assert!((seen - expected).abs() < 2e-6, "{count} of {of}: {seen}");
        }
    }

    #[test]
    fn rates_are_those_of_poisson() {
        // Reference: the root of sum e^-m m^i / i! = 0.05.
        for (count, expected) in [(0, 2.995_732), (1, 4.743_865), (7, 13.148_114)] {
            let seen = Rate { count, hours: 2.0 }.upper_bound();
            assert!((seen - expected / 2.0).abs() < 1e-5, "{count}: {seen}");
        }
    }
}
