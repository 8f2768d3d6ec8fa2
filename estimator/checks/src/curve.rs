//! Second equation: curvature driven against the steering angle.

use crate::fit::{self, Equation, Fit, median, quantile};

/// Largest tilt of the tangent that is followed, rad.
const ANGLE_MAX_RAD: f64 = 1.45;
/// Gears that are tried, and the smallest of them: degrees are 1/57.
const GEARS: usize = 24;
const GEAR_MIN: f64 = 1.0 / 80.0;
const GEAR_MAX: f64 = 20.0;
/// Steps towards the zero of the angle.
const ZERO_STEPS: usize = 3;
/// Middle angle beyond which a sensor's zero is elsewhere, rad.
const FAR_ZERO_RAD: f64 = 1.2;

/// One piece of the way: the curve driven, times the described wheelbase, and the angle as sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bend {
    pub curve: f64,
    pub angle_rad: f64,
    /// Weight, the speed.
    pub weight: f64,
}

/// `curve = c tan(g angle - zero)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Curve {
    pub rms: f64,
    pub gear: f64,
    pub c: f64,
    pub zero_rad: f64,
}

impl Curve {
    /// Tangent of the true angle of a bend.
    fn tan(&self, bend: &Bend) -> f64 {
        let angle_rad = self.gear * bend.angle_rad - self.zero_rad;
        angle_rad.clamp(-ANGLE_MAX_RAD, ANGLE_MAX_RAD).tan()
    }

    /// Returns the turn driven over the turn by angle and wheelbase, at small angles.
    pub fn slope(&self) -> f64 {
        self.gear * self.c
    }
}

/// Bends from which the angle is determined.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Bends {
    bends: Vec<Bend>,
    /// Angle around which the others lie, where the sensor's zero is elsewhere.
    middle_rad: f64,
}

impl Bends {
    pub fn new(bends: Vec<Bend>) -> Self {
        let mut angles: Vec<f64> = bends.iter().map(|of| of.angle_rad).collect();
        let middle = median(&mut angles);
        let mut around: Vec<f64> = angles.iter().map(|angle| (angle - middle).abs()).collect();
        let is_far = middle.abs() > FAR_ZERO_RAD && quantile(&mut around, 0.95) < 1.0;
        Self {
            bends,
            middle_rad: if is_far { middle } else { 0.0 },
        }
    }

    pub fn len(&self) -> usize {
        self.bends.len()
    }

    /// A quantile of the curves driven.
    pub fn curve_quantile(&self, share: f64) -> f64 {
        quantile(
            &mut self.bends.iter().map(|of| of.curve).collect::<Vec<_>>(),
            share,
        )
    }

    /// Standard deviation of the weighted curves.
    pub fn spread(&self) -> f64 {
        let count = self.bends.len().max(1) as f64;
        let weighted = || self.bends.iter().map(|of| of.curve * of.weight);
        let mean = weighted().sum::<f64>() / count;
        (weighted().map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt()
    }

    /// The best curve of any gear.
    pub fn free(&self) -> Option<Curve> {
        let away = |of: &Bend| (of.angle_rad - self.middle_rad).abs();
        let widest = quantile(&mut self.bends.iter().map(away).collect::<Vec<_>>(), 0.98);
        let most = (1.3 / widest.max(1e-6)).min(GEAR_MAX);
        let step = (GEAR_MAX / GEAR_MIN).ln() / (GEARS - 1) as f64;
        let gears = (0..GEARS).map(|k| GEAR_MIN * (step * k as f64).exp());
        let curves = gears
            .filter(|gear| *gear <= most)
            .filter_map(|gear| self.of_gear(gear));
        curves.min_by(|a, b| a.rms.total_cmp(&b.rms))
    }

    /// The best curve of a gear, with any `c`.
    pub fn of_gear(&self, gear: f64) -> Option<Curve> {
        self.approach(
            gear,
            |bend, tan| Equation {
                a: tan,
                b: -(1.0 + tan * tan),
                y: bend.curve,
                weight: bend.weight,
            },
            |curve, fit| {
                curve.c = fit.first;
                curve.zero_rad += if fit.first.abs() > 1e-9 {
                    fit.second / fit.first
                } else {
                    0.0
                };
            },
        )
    }

    /// The best gear near one with the described wheelbase.
    pub fn of_wheelbase(&self, gear: f64) -> Option<Curve> {
        self.approach(
            gear,
            |bend, tan| Equation {
                a: (1.0 + tan * tan) * bend.angle_rad,
                b: -(1.0 + tan * tan),
                y: bend.curve - tan,
                weight: bend.weight,
            },
            |curve, fit| {
                curve.gear += fit.first;
                curve.zero_rad += fit.second;
            },
        )
    }

    /// Solves linear equations at the curve's tangents again and again.
    fn approach(
        &self,
        gear: f64,
        equation: impl Fn(&Bend, f64) -> Equation<f64>,
        step: impl Fn(&mut Curve, &Fit<f64>),
    ) -> Option<Curve> {
        let mut curve = Curve {
            rms: f64::INFINITY,
            gear,
            c: 1.0,
            zero_rad: gear * self.middle_rad,
        };
        let limit = 1.5 + (gear * self.middle_rad).abs();
        for _ in 0..ZERO_STEPS {
            let equations = self
                .bends
                .iter()
                .map(|bend| equation(bend, curve.tan(bend)));
            let fit = fit::real(&equations.collect::<Vec<_>>())?;
            step(&mut curve, &fit);
            curve.zero_rad = curve.zero_rad.clamp(-limit, limit);
            curve.rms = fit.rms;
        }
        Some(curve)
    }

    /// Returns the loss of turn for each tangent and curve, and the share of the residuals' size that it
    /// leaves. Of one wheel of a linkage it is half the track over the wheelbase, since
    /// `1/curve = 1/tan + track / (2 L)`: positive of the left wheel.
    pub fn linkage(&self, curve: &Curve) -> Option<(f64, f64)> {
        let mut tans: Vec<f64> = self.bends.iter().map(|bend| curve.tan(bend)).collect();
        let is_wide = quantile(&mut tans, 0.95) > 0.25 && quantile(&mut tans, 0.05) < -0.25;
        if !is_wide {
            return None;
        }
        // The line's zero has taken a part of it, `e (1 + tan²)`, which its constant shows.
        let equation = |bend: &Bend| Equation {
            a: -curve.tan(bend) * bend.curve,
            b: 1.0,
            y: bend.curve - curve.c * curve.tan(bend),
            weight: bend.weight,
        };
        let fit = fit::real(&self.bends.iter().map(equation).collect::<Vec<_>>())?;
        Some((fit.first + fit.second, fit.rms / curve.rms.max(1e-9)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bends of a vehicle whose true angle is `gear (sent - zero)`, with tangents times `c`.
    fn bends(gear: f64, zero_rad: f64, c: f64) -> Bends {
        let bend = |i: i32| {
            let true_rad = 0.5 * (f64::from(i) * 0.17).sin();
            Bend {
                curve: c * true_rad.tan() + 0.002 * (f64::from(i) * 1.7).sin(),
                angle_rad: true_rad / gear + zero_rad,
                weight: 1.0,
            }
        };
        Bends::new((0..180).map(bend).collect())
    }

    #[test]
    fn degrees_columns_and_zeros_are_found() {
        for (gear, zero_rad) in [
            (0.017_453_3, 2.0),
            (1.0 / 14.8, 0.3),
            (1.0, 1.58),
            (-1.0, 0.02),
            (0.5, 0.0),
        ] {
            let curve = bends(gear, zero_rad, 1.0).free().unwrap();
            let (slope, zero) = (curve.slope(), curve.zero_rad / curve.gear);
            assert!((slope / gear - 1.0).abs() < 0.03, "{gear}: {curve:?}");
            assert!(
                (zero - zero_rad).abs() < 0.02 / gear.abs(),
                "{zero_rad}: {curve:?}"
            );
        }
    }

    #[test]
    fn a_gear_is_told_from_a_wheelbase() {
        for (bends, gear_fits) in [(bends(0.6, 0.0, 1.0), true), (bends(1.0, 0.0, 0.6), false)] {
            let slope = bends.free().unwrap().slope();
            let gear = bends.of_wheelbase(slope).unwrap();
            let wheelbase = bends.of_gear(1.0).unwrap();
            assert_eq!(
                gear.rms < wheelbase.rms,
                gear_fits,
                "{gear:?} {wheelbase:?}"
            );
        }
    }
}
