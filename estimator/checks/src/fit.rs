//! Robust least squares of two unknowns, real or complex.

use nalgebra::Complex;

/// Number of times that the weights are computed from the residuals again.
const REWEIGHTED: usize = 5;

/// Solution of a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fit<T> {
    pub first: T,
    pub second: T,
    /// Root mean square of the residuals, those of outliers cut.
    pub rms: f64,
    /// Median of the residuals' sizes.
    pub median: f64,
}

/// One equation `y = first * a + second * b`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Equation<T> {
    pub a: T,
    pub b: T,
    pub y: T,
    /// Weight of the residual.
    pub weight: f64,
}

/// Middle value, which need not be sorted.
pub(crate) fn median(values: &mut [f64]) -> f64 {
    quantile(values, 0.5)
}

/// Value below which a share of the values lies; NaN of none.
pub(crate) fn quantile(values: &mut [f64], share: f64) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let at = ((values.len() - 1) as f64 * share).round() as usize;
    let (_, value, _) = values.select_nth_unstable_by(at, f64::total_cmp);
    *value
}

/// Fits complex equations: `y = first * a + second * b`.
pub(crate) fn complex(equations: &[Equation<Complex<f64>>]) -> Option<Fit<Complex<f64>>> {
    reweighted(
        equations,
        |weights| {
            let (mut aa, mut bb, zero) = (0.0, 0.0, Complex::new(0.0, 0.0));
            let (mut ab, mut ay, mut by) = (zero, zero, zero);
            for (of, w) in equations.iter().zip(weights) {
                aa += w * of.a.norm_sqr();
                bb += w * of.b.norm_sqr();
                ab += of.a.conj() * of.b * *w;
                ay += of.a.conj() * of.y * *w;
                by += of.b.conj() * of.y * *w;
            }
            let determinant = aa * bb - ab.norm_sqr();
            if determinant <= 1e-9 * aa * bb {
                return None;
            }
            let first = (ay * bb - ab * by) / determinant;
            let second = (by * aa - ab.conj() * ay) / determinant;
            Some((first, second))
        },
        |of, (first, second)| (of.y - first * of.a - second * of.b).norm(),
    )
}

/// Fits real equations: `y = first * a + second * b`.
pub(crate) fn real(equations: &[Equation<f64>]) -> Option<Fit<f64>> {
    reweighted(
        equations,
        |weights| {
            let (mut aa, mut ab, mut bb, mut ay, mut by) = (0.0, 0.0, 0.0, 0.0, 0.0);
            for (of, w) in equations.iter().zip(weights) {
                aa += w * of.a * of.a;
                ab += w * of.a * of.b;
                bb += w * of.b * of.b;
                ay += w * of.a * of.y;
                by += w * of.b * of.y;
            }
            // An unknown whose column is empty is 0.
            if bb <= 0.0 {
                return (aa > 0.0).then(|| (ay / aa, 0.0));
            }
            let determinant = aa * bb - ab * ab;
            (determinant > 1e-12 * aa * bb).then(|| {
                (
                    (ay * bb - ab * by) / determinant,
                    (by * aa - ab * ay) / determinant,
                )
            })
        },
        |of, (first, second)| (of.y - first * of.a - second * of.b).abs(),
    )
}

/// Solves again and again with weights from the residuals.
fn reweighted<T: Copy>(
    equations: &[Equation<T>],
    solve: impl Fn(&[f64]) -> Option<(T, T)>,
    residual: impl Fn(&Equation<T>, (T, T)) -> f64,
) -> Option<Fit<T>> {
    let mut weights: Vec<f64> = equations.iter().map(|of| of.weight * of.weight).collect();
    let mut residuals = vec![0.0; equations.len()];
    let mut fit = None;
    for _ in 0..REWEIGHTED {
        let (first, second) = solve(&weights)?;
        for (of, into) in equations.iter().zip(&mut residuals) {
            *into = of.weight * residual(of, (first, second));
        }
        let middle = median(&mut residuals.clone());
        let scale = 1.5 * middle + 1e-5;
        for ((of, r), weight) in equations.iter().zip(&residuals).zip(&mut weights) {
            *weight = of.weight * of.weight / (1.0 + (r / (2.0 * scale)).powi(2));
        }
        let square = |r: &f64| r.min(6.0 * scale).powi(2);
        let mean = residuals.iter().map(square).sum::<f64>() / residuals.len().max(1) as f64;
        fit = Some(Fit {
            first,
            second,
            rms: mean.sqrt(),
            median: middle,
        });
    }
    fit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_do_not_bend_a_fit() {
        let equation = |i: i32| {
            let (a, b) = (f64::from(i), f64::from(i * i % 7));
            let wild = if i % 10 == 0 { 50.0 } else { 0.0 };
            Equation {
                a,
                b,
                y: 2.0 * a - 0.5 * b + wild,
                weight: 1.0,
            }
        };
        let fit = real(&(1..60).map(equation).collect::<Vec<_>>()).unwrap();
        assert!((fit.first - 2.0).abs() < 0.02, "{fit:?}");
        assert!((fit.second + 0.5).abs() < 0.1, "{fit:?}");
    }

    #[test]
    fn a_complex_fit_finds_a_turn_and_a_lever() {
        let (first, second) = (Complex::from_polar(0.9, 0.3), Complex::new(0.06, 0.4));
        let equation = |i: i32| {
            let (a, b) = (
                Complex::from(f64::from(i % 5)),
                Complex::from(f64::from(i % 3)),
            );
            Equation {
                a,
                b,
                y: first * a + second * b,
                weight: 1.0,
            }
        };
        let fit = complex(&(0..40).map(equation).collect::<Vec<_>>()).unwrap();
        assert!((fit.first - first).norm() < 1e-9 && (fit.second - second).norm() < 1e-9);
        let still = [Equation {
            a: Complex::from(0.0),
            ..equation(1)
        }; 9];
        assert!(complex(&still).is_none());
    }
}
