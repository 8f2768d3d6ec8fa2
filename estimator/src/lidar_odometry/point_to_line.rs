//! Point-to-line alignment of a sweep with the local map, pose and velocity at once.
//!
//! A beam taken `tau` seconds from the reference time at the point `p` (LiDAR's frame) lies, for
//! the pose `T` and the velocity `v` there, at `T * exp(tau v) * p`. Its residual is the distance
//! to the line of the cell it falls into; `exp(tau v)` is the correction of the rolling sweep, so
//! each iteration corrects the sweep again with the motion just found.
//! With the normal `m` seen from the LiDAR and `q = exp(tau v) p` the derivative is
//! `j = (m, m_y q_x - m_x q_y)` for the pose and `tau j` for the velocity.

use nalgebra::{Matrix3, Matrix6, Vector2, Vector3, Vector6};

use super::beam_filter::SweepPoints;
use super::motion::Motion;
use super::submap::{FreeSpace, LocalOrigin, Submap};
use super::tracking::Fit;

/// Beyond this many of its sigmas a residual loses its weight (Geman-McClure).
const ROBUST_SIGMAS: f32 = 3.0;
/// Least standard deviation of a residual, m: the map is no better than this.
const RESIDUAL_FLOOR_M: f32 = 0.002;
/// Within this many sigmas a point lies on the map.
const ON_MAP_SIGMAS: f32 = 4.0;

/// A surface whose normal is nearer to a direction than this (cosine of 75°) faces it.
const FACING_COS: f32 = 0.26;

/// The normal equations of one pass over the points.
#[derive(Debug, Clone)]
pub struct NormalEquations {
    /// Information on pose and velocity.
    pub information: Matrix6<f64>,
    /// Minus the gradient.
    pub gradient: Vector6<f64>,
    /// Points on their line within its noise.
    pub on_map: f32,
    /// Sum of their squared residuals over their variances.
    pub chi2: f32,
}

/// Sums over points, in the order xx, xy, xt, yy, yt, tt of the pose's information.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    pose: [f32; 6],
    pose_velocity: [f32; 6],
    velocity: [f32; 6],
    gradient_pose: [f32; 3],
    gradient_velocity: [f32; 3],
}

/// Pose and velocity in single precision, measured from a local origin.
#[derive(Debug, Clone, Copy)]
pub struct LocalMotion {
    /// The origin.
    pub origin: LocalOrigin,
    x: f32,
    y: f32,
    cos: f32,
    sin: f32,
    vx: f32,
    vy: f32,
    omega: f32,
}

impl LocalMotion {
    /// `motion` as seen from `origin`.
    pub fn new(motion: &Motion, origin: LocalOrigin) -> Self {
        let (ox, oy) = origin.position_m();
        let (sin, cos) = motion.pose.yaw_rad.sin_cos();
        Self {
            origin,
            x: (motion.pose.x_m - ox) as f32,
            y: (motion.pose.y_m - oy) as f32,
            cos: cos as f32,
            sin: sin as f32,
            vx: motion.velocity.x as f32,
            vy: motion.velocity.y as f32,
            omega: motion.velocity.z as f32,
        }
    }

    /// The LiDAR's position.
    pub fn position(&self) -> (f32, f32) {
        (self.x, self.y)
    }

    /// Deskews a point: where a beam taken at `tau` would have hit at the reference time.
    #[inline]
    pub fn deskew(&self, x: f32, y: f32, tau: f32) -> (f32, f32) {
        let a = tau * self.omega;
        let a2 = a * a;
        let s = a * (1.0 - a2 * (1.0 / 6.0 - a2 * (1.0 / 120.0)));
        let c = 1.0 - a2 * (0.5 - a2 * (1.0 / 24.0 - a2 * (1.0 / 720.0)));
        // (sin a)/a and (1 - cos a)/a of the exponential map.
        let sa = 1.0 - a2 * (1.0 / 6.0 - a2 * (1.0 / 120.0));
        let ca = a * (0.5 - a2 * (1.0 / 24.0));
        let (tx, ty) = (tau * self.vx, tau * self.vy);
        (
            c * x - s * y + sa * tx - ca * ty,
            s * x + c * y + ca * tx + sa * ty,
        )
    }

    /// A deskewed point, seen from the origin.
    #[inline]
    pub fn transform(&self, x: f32, y: f32) -> (f32, f32) {
        (
            self.cos * x - self.sin * y + self.x,
            self.sin * x + self.cos * y + self.y,
        )
    }
}

/// A point against the line of its cell.
#[derive(Debug, Clone, Copy)]
struct Residual {
    /// The deskewed point in the LiDAR's frame.
    q: (f32, f32),
    /// The line's normal in the LiDAR's frame.
    m: (f32, f32),
    /// Distance from the line, m.
    distance: f32,
    /// Variance of the distance, m²: of the range, as the line sees it, and of the line.
    variance: f32,
}

/// The points of a sweep laid over the map: the one place where residuals come from.
#[derive(Clone, Copy)]
pub struct Alignment<'a> {
    /// The sweep.
    pub points: &'a SweepPoints,
    /// The map.
    pub submap: &'a Submap,
    /// The scanner's range noise, m.
    pub range_noise_m: f32,
}

impl Alignment<'_> {
    /// The residual of a point, where its cell has a line.
    #[inline]
    fn residual(
        &self,
        motion: &LocalMotion,
        (px, py): (f32, f32),
        tau: f32,
        inverse_range: f32,
    ) -> Option<Residual> {
        let (qx, qy) = motion.deskew(px, py, tau);
        let (wx, wy) = motion.transform(qx, qy);
        let (cell, cx, cy) = motion.origin.locate(wx, wy);
        let line = self.submap.line(cell);
        if !line.exists() {
            return None;
        }
        let mx = motion.cos * line.nx + motion.sin * line.ny;
        let my = motion.cos * line.ny - motion.sin * line.nx;
        let seen_m = (mx * qx + my * qy) * inverse_range * self.range_noise_m;
        Some(Residual {
            q: (qx, qy),
            m: (mx, my),
            distance: line.nx * cx + line.ny * cy - line.d,
            variance: seen_m * seen_m + line.variance + RESIDUAL_FLOOR_M * RESIDUAL_FLOOR_M,
        })
    }

    /// The points, each with its time and one over its range.
    fn beams(&self) -> impl Iterator<Item = ((f32, f32), f32, f32)> {
        let SweepPoints {
            x,
            y,
            tau,
            inverse_range,
            ..
        } = self.points;
        let positions = x.iter().zip(y);
        positions
            .zip(tau.iter().zip(inverse_range))
            .map(|((x, y), (tau, r))| ((*x, *y), *tau, *r))
    }

    /// One pass over every `stride`-th point: residuals, weights and the normal equations.
    pub fn linearise(&self, motion: &LocalMotion, stride: usize) -> NormalEquations {
        let mut sums = Sums::default();
        let (mut on_map, mut chi2) = (0.0, 0.0);
        for (point, tau, inverse_range) in self.beams().step_by(stride) {
            let Some(residual) = self.residual(motion, point, tau, inverse_range) else {
                continue;
            };
            let Residual {
                q: (qx, qy),
                m: (mx, my),
                distance,
                variance,
            } = residual;
            let normalised2 = distance * distance / variance;
            if normalised2 < ON_MAP_SIGMAS * ON_MAP_SIGMAS {
                on_map += 1.0;
                chi2 += normalised2;
            }
            let robust = 1.0 / (1.0 + normalised2 * (1.0 / (ROBUST_SIGMAS * ROBUST_SIGMAS)));
            let weight = robust * robust / variance;
            sums.add([mx, my, my * qx - mx * qy], tau, distance, weight);
        }
        sums.into_equations(on_map, chi2)
    }

    /// The information of the surfaces that face `direction` (LiDAR's frame) on the position
    /// along it: the others tell of it only through the noise of their normals.
    pub fn information_facing(&self, motion: &LocalMotion, direction: Vector2<f64>) -> f64 {
        let (ex, ey) = (direction.x as f32, direction.y as f32);
        let mut sum = 0.0;
        for (point, tau, inverse_range) in self.beams() {
            let Some(residual) = self.residual(motion, point, tau, inverse_range) else {
                continue;
            };
            let facing = residual.m.0 * ex + residual.m.1 * ey;
            if facing.abs() > FACING_COS {
                sum += facing * facing / residual.variance;
            }
        }
        f64::from(sum)
    }

    /// Sorts every `stride`-th point: on the map, where space was seen free, or neither.
    pub fn assess(&self, motion: &LocalMotion, free_space: &FreeSpace, stride: usize) -> Fit {
        let mut fit = Fit::default();
        for (point, tau, inverse_range) in self.beams().step_by(stride) {
            fit.points += 1.0;
            if let Some(Residual {
                distance, variance, ..
            }) = self.residual(motion, point, tau, inverse_range)
            {
                let normalised2 = distance * distance / variance;
                fit.score += 1.0 / (1.0 + normalised2 * (1.0 / (ROBUST_SIGMAS * ROBUST_SIGMAS)));
                if normalised2 < ON_MAP_SIGMAS * ON_MAP_SIGMAS {
                    fit.on_map += 1.0;
                    continue;
                }
            }
            let (qx, qy) = motion.deskew(point.0, point.1, tau);
            let (wx, wy) = motion.transform(qx, qy);
            if free_space.was_free(motion.origin.locate(wx, wy).0) {
                fit.moving += 1.0;
            }
        }
        fit
    }
}

impl Sums {
    #[inline]
    fn add(&mut self, j: [f32; 3], tau: f32, residual: f32, weight: f32) {
        let [jx, jy, jt] = j;
        let products = [jx * jx, jx * jy, jx * jt, jy * jy, jy * jt, jt * jt];
        let (w1, w2) = (weight * tau, weight * tau * tau);
        for (index, product) in products.into_iter().enumerate() {
            self.pose[index] += weight * product;
            self.pose_velocity[index] += w1 * product;
            self.velocity[index] += w2 * product;
        }
        let (g0, g1) = (weight * residual, w1 * residual);
        for (index, derivative) in j.into_iter().enumerate() {
            self.gradient_pose[index] -= g0 * derivative;
            self.gradient_velocity[index] -= g1 * derivative;
        }
    }

    fn into_equations(self, on_map: f32, chi2: f32) -> NormalEquations {
        let block = |s: [f32; 6]| {
            let [xx, xy, xt, yy, yt, tt] = s.map(f64::from);
            Matrix3::new(xx, xy, xt, xy, yy, yt, xt, yt, tt)
        };
        let vector = |s: [f32; 3]| Vector3::from(s.map(f64::from));
        let mut information = Matrix6::zeros();
        information
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&block(self.pose));
        information
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&block(self.pose_velocity));
        information
            .fixed_view_mut::<3, 3>(3, 0)
            .copy_from(&block(self.pose_velocity));
        information
            .fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&block(self.velocity));
        let mut gradient = Vector6::zeros();
        gradient
            .fixed_rows_mut::<3>(0)
            .copy_from(&vector(self.gradient_pose));
        gradient
            .fixed_rows_mut::<3>(3)
            .copy_from(&vector(self.gradient_velocity));
        NormalEquations {
            information,
            gradient,
            on_map,
            chi2,
        }
    }
}
