//! Lag between two series of motion, by correlation.

use crate::grid::CELL_S;

/// Cells from one compared cell to the next in the search over all lags.
const COARSE: i64 = 2;
/// Cells around the best coarse lag that are searched finely.
const FINE: i64 = 6;
/// Least share of the cells that two shifted series have to share.
const SHARED_MIN: f64 = 0.5;
/// Distance over which the peak's bend is taken, cells.
const BEND: i64 = 4;
/// Fewest cells of a correlation.
const CELLS_MIN: usize = 50;
/// Deviation of a lag that is not known, s.
const UNKNOWN_S: f64 = 9.0;

/// Delay of a second series behind a first one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lag {
    pub late_s: f64,
    /// Its standard deviation, s.
    pub sigma_s: f64,
    /// Correlation at that lag, 0 to 1.
    pub correlation: f64,
    /// Correlation without a lag.
    pub unshifted: f64,
}

/// A lag of which nothing is known.
pub(crate) const UNKNOWN: Lag = Lag {
    late_s: 0.0,
    sigma_s: UNKNOWN_S,
    correlation: 0.0,
    unshifted: 0.0,
};

/// A series, cell by cell: a plane vector of the LiDAR or a number as (number, 0); NaN for none.
pub(crate) type Vectors = Vec<(f32, f32)>;
/// A series of numbers; NaN for none.
pub(crate) type Numbers = Vec<f32>;

/// Size of the correlation of vectors with numbers that come `shift` cells later, by any turn of the
/// vectors; the sign does not count.
fn correlation(first: &Vectors, second: &Numbers, shift: i64, step: i64) -> f64 {
    let length = first.len().min(second.len()) as i64;
    let (from, to) = (0.max(-shift), length.min(length - shift));
    let (mut n, mut sx, mut sy, mut sv) = (0_u32, 0.0_f64, 0.0_f64, 0.0_f64);
    let (mut sxx, mut svv, mut sxv, mut syv) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
    let mut at = from;
    while at < to {
        let ((x, y), v) = (first[at as usize], second[(at + shift) as usize]);
        at += step;
        let (x, y, v) = (f64::from(x), f64::from(y), f64::from(v));
        if !(x.is_finite() && v.is_finite()) {
            continue;
        }
        n += 1;
        sx += x;
        sy += y;
        sv += v;
        sxx += x * x + y * y;
        svv += v * v;
        sxv += x * v;
        syv += y * v;
    }
    let count = f64::from(n);
    if count * step as f64 <= SHARED_MIN * length as f64 || n == 0 {
        return 0.0;
    }
    let first_variance = sxx - (sx * sx + sy * sy) / count;
    let second_variance = svv - sv * sv / count;
    let (x, y) = (sxv - sx * sv / count, syv - sy * sv / count);
    let product = first_variance * second_variance;
    if product > 1e-9 * count * count * 1e-6 {
        (x.hypot(y) / product.sqrt()).min(1.0)
    } else {
        0.0
    }
}

/// The lag at which the correlation is largest, up to `reach_s` either way.
pub(crate) fn best(first: &Vectors, second: &Numbers, reach_s: f64) -> Lag {
    let length = first.len().min(second.len());
    if length < CELLS_MIN {
        return UNKNOWN;
    }
    let reach = ((reach_s / CELL_S) as i64).min(3 * length as i64 / 10);
    let at = |shift| correlation(first, second, shift, 1);
    let coarse = (-reach / COARSE..=reach / COARSE)
        .map(|k| k * COARSE)
        .map(|shift| (correlation(first, second, shift, COARSE), shift))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let Some((_, near)) = coarse else {
        return UNKNOWN;
    };
    let fine = (near - FINE..=near + FINE)
        .filter(|shift| shift.abs() <= reach)
        .map(|shift| (at(shift), shift))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let Some((peak, shift)) = fine else {
        return UNKNOWN;
    };
    let mut lag = Lag {
        late_s: shift as f64 * CELL_S,
        sigma_s: UNKNOWN_S,
        correlation: peak,
        unshifted: at(0),
    };
    if shift.abs() >= reach {
        return lag;
    }
    let (before, after) = (at(shift - 1), at(shift + 1));
    let bend = before - 2.0 * peak + after;
    if bend < 0.0 {
        lag.late_s += 0.5 * (before - after) / bend * CELL_S;
    }
    let (low, high) = ((shift - BEND).max(-reach), (shift + BEND).min(reach));
    let half_s = 0.5 * (high - low) as f64 * CELL_S;
    let wide_bend = (2.0 * peak - at(low) - at(high)) / (half_s * half_s);
    if wide_bend > 0.0 {
        // The residuals are alike for about a second.
        let independent = (length as f64 * CELL_S).max(1.0);
        lag.sigma_s = ((1.0 - peak * peak).max(1e-4) / wide_bend.max(1e-6) / independent).sqrt();
    }
    lag
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lag_is_found_between_cells_and_whatever_the_turn_and_sign() {
        let motion = |time_s: f64| 1.0 + 0.4 * (0.7 * time_s).sin() + 0.2 * (1.9 * time_s).cos();
        let times = || (0..500).map(|cell| f64::from(cell) * CELL_S);
        let first: Vectors = times()
            .map(|t| (-0.8 * motion(t)) as f32)
            .zip(times().map(|t| (0.3 * motion(t)) as f32))
            .collect();
        for wanted_s in [-3.37, -0.04, 0.0, 0.213, 5.5] {
            let second: Numbers = times().map(|t| motion(t - wanted_s) as f32).collect();
            let lag = best(&first, &second, 8.0);
            assert!((lag.late_s - wanted_s).abs() < 0.02, "{wanted_s}: {lag:?}");
            assert!(lag.correlation > 0.98 && lag.sigma_s < 0.05, "{lag:?}");
        }
    }

    #[test]
    fn a_steady_speed_shows_no_lag() {
        let first: Vectors = vec![(1.0, 0.0); 400];
        assert_eq!(
            best(&first, &vec![1.0; 400], 8.0)
                .correlation
                .total_cmp(&0.0),
            std::cmp::Ordering::Equal
        );
    }
}
