//! Distribution of one value over robots.

use serde::Serialize;

/// Ratio of a normal distribution's standard deviation to its median absolute deviation.
const SIGMA_OVER_MAD: f64 = 1.4826;

/// Distribution of one value over robots, in the unit of the value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Distribution {
    /// Number of robots whose value is known.
    pub robots: usize,
    /// Smallest value.
    pub smallest: f64,
    /// Value that a quarter of the robots lie below.
    pub lower_quartile: f64,
    /// Value that half of the robots lie below.
    pub median: f64,
    /// Value that three quarters of the robots lie below.
    pub upper_quartile: f64,
    /// Largest value.
    pub largest: f64,
}

impl Distribution {
    /// Distribution of these values; `None` without any.
    pub fn of(mut values: Vec<f64>) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        Some(Self {
            robots: values.len(),
            smallest: *values.first()?,
            lower_quartile: quantile(&values, 0.25)?,
            median: quantile(&values, 0.5)?,
            upper_quartile: quantile(&values, 0.75)?,
            largest: *values.last()?,
        })
    }
}

impl Distribution {
    /// The same distribution with all values larger by `by`.
    pub(crate) fn moved(self, by: f64) -> Self {
        Self {
            robots: self.robots,
            smallest: self.smallest + by,
            lower_quartile: self.lower_quartile + by,
            median: self.median + by,
            upper_quartile: self.upper_quartile + by,
            largest: self.largest + by,
        }
    }
}

/// Value that a share of sorted values lies below, interpolated between its neighbours.
fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let place = share * sorted.len().checked_sub(1)? as f64;
    let below = place.floor() as usize;
    let lower = sorted.get(below)?;
    let upper = sorted.get(below + 1).unwrap_or(lower);
    Some(lower + (upper - lower) * place.fract())
}

/// Median and robust standard deviation of values, by their median absolute deviation; `None`
/// without any.
pub(crate) fn centre_and_spread(values: &[f64]) -> Option<(f64, f64)> {
    let median = Distribution::of(values.to_vec())?.median;
    let distances = values.iter().map(|value| (value - median).abs());
    let mad = Distribution::of(distances.collect())?.median;
    Some((median, SIGMA_OVER_MAD * mad))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_lie_between_the_values() {
        let four = Distribution::of(vec![4.0, 1.0, 3.0, 2.0]).unwrap();
        let expected = Distribution {
            robots: 4,
            smallest: 1.0,
            lower_quartile: 1.75,
            median: 2.5,
            upper_quartile: 3.25,
            largest: 4.0,
        };
        assert_eq!(four, expected);
        let one = Distribution::of(vec![7.0]).unwrap();
        assert_eq!((one.lower_quartile, one.upper_quartile), (7.0, 7.0));
        assert_eq!(Distribution::of(Vec::new()), None);
    }

    #[test]
    fn one_wild_value_moves_neither_centre_nor_spread_far() {
        let mut values: Vec<f64> = (-20..=20).map(f64::from).collect();
        let (centre, spread) = centre_and_spread(&values).unwrap();
        values.push(1e9);
        let (with, wider) = centre_and_spread(&values).unwrap();
        assert!((with - centre).abs() < 1.0 && wider < 1.1 * spread);
    }
}
