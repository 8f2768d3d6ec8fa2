//! Point-to-line alignment of a sweep with the local map, pose and velocity at once.
//!
//! A beam taken `tau` seconds from the reference time at the point `p` (LiDAR's frame) lies, for
//! the pose `T` and the velocity `v` there, at `T * exp(tau v) * p`. Its residual is the distance
//! to the line of the cell it falls into; `exp(tau v)` is the correction of the rolling sweep, so
//! each iteration corrects the sweep again with the motion just found.
//! With the normal `m` seen from the LiDAR and `q = exp(tau v) p` the derivative is
//! `j = (m, m_y q_x - m_x q_y)` for the pose and `tau j` for the velocity.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use super::beam_filter::SweepPoints;
use super::motion::Motion;
use super::submap::{LocalOrigin, Submap};

/// Beyond this many of its sigmas a residual loses its weight (Geman-McClure).
const ROBUST_SIGMAS: f32 = 3.0;
/// Least standard deviation of a residual, m: the map is no better than this.
const RESIDUAL_FLOOR_M: f32 = 0.002;
/// Within this many sigmas a point lies on the map.
const ON_MAP_SIGMAS: f32 = 4.0;

/// How the points of a sweep fit the map at one pose.
#[derive(Debug, Clone, Copy, Default)]
pub struct Fit {
    /// Points used.
    pub points: f32,
    /// Points in a cell that has a line.
    pub matched: f32,
    /// Points on their line within its noise.
    pub on_map: f32,
    /// Sum of the squared residuals of the points on the map over their variances.
    pub chi2: f32,
}

impl Fit {
    /// Share of the points that lie on the map.
    pub fn fitness(&self) -> f64 {
        if self.points > 0.0 {
            f64::from(self.on_map / self.points)
        } else {
            0.0
        }
    }
}

/// The normal equations of one pass over the points.
#[derive(Debug, Clone)]
pub struct NormalEquations {
    /// Information on pose and velocity.
    pub information: Matrix6<f64>,
    /// Minus the gradient.
    pub gradient: Vector6<f64>,
    /// How the points fit.
    pub fit: Fit,
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

/// One pass over the points: residuals, weights and the normal equations at `motion`. Of the
/// points every `stride`-th is used.
pub fn linearise(
    points: &SweepPoints,
    submap: &Submap,
    motion: &LocalMotion,
    range_noise_m: f32,
    stride: usize,
) -> NormalEquations {
    let mut sums = Sums::default();
    let mut fit = Fit::default();
    let noise2 = range_noise_m * range_noise_m;
    let positions = points.x.iter().zip(&points.y);
    let timed = positions.zip(points.tau.iter().zip(&points.inverse_range));
    for ((&px, &py), (&tau, &inverse_range)) in timed.step_by(stride) {
        fit.points += 1.0;
        let (qx, qy) = motion.deskew(px, py, tau);
        let (wx, wy) = motion.transform(qx, qy);
        let (cell, cx, cy) = motion.origin.locate(wx, wy);
        let line = submap.line(cell);
        if !line.exists() {
            continue;
        }
        fit.matched += 1.0;
        let residual = line.nx * cx + line.ny * cy - line.d;
        let mx = motion.cos * line.nx + motion.sin * line.ny;
        let my = motion.cos * line.ny - motion.sin * line.nx;
        let cos_incidence = (mx * qx + my * qy) * inverse_range;
        let variance = noise2 * cos_incidence * cos_incidence
            + line.variance
            + RESIDUAL_FLOOR_M * RESIDUAL_FLOOR_M;
        let normalised2 = residual * residual / variance;
        if normalised2 < ON_MAP_SIGMAS * ON_MAP_SIGMAS {
            fit.on_map += 1.0;
            fit.chi2 += normalised2;
        }
        let robust = 1.0 / (1.0 + normalised2 * (1.0 / (ROBUST_SIGMAS * ROBUST_SIGMAS)));
        sums.add(
            [mx, my, my * qx - mx * qy],
            tau,
            residual,
            robust * robust / variance,
        );
    }
    sums.into_equations(fit)
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

    fn into_equations(self, fit: Fit) -> NormalEquations {
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
            fit,
        }
    }
}
