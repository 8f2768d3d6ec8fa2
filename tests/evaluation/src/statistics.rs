//! Means and spreads.

/// Root of the mean square.
pub fn rms(values: &[f64]) -> f64 {
    let squares: f64 = values.iter().map(|value| value * value).sum();
    (squares / values.len().max(1) as f64).sqrt()
}

/// Mean.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Standard deviation of a sample.
pub fn spread(values: &[f64]) -> f64 {
    let middle = mean(values);
    let squares: f64 = values.iter().map(|value| (value - middle).powi(2)).sum();
    (squares / (values.len().max(2) - 1) as f64).sqrt()
}

/// Largest absolute value.
pub fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most, value| most.max(value.abs()))
}

/// The value below which `share` of the absolute values lie.
pub fn quantile_of_size(values: &[f64], share: f64) -> f64 {
    let mut sizes: Vec<_> = values.iter().map(|value| value.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let place = (share * sizes.len().saturating_sub(1) as f64).round() as usize;
    sizes.get(place).copied().unwrap_or_default()
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
}
