//! The LiDAR's motion in single precision, and what it makes of a scan's points.

use super::beam_filter::{Block, LANES};
use super::motion::Motion;
use super::submap::LocalOrigin;

/// A block's points, corrected for the motion within the scan.
pub struct Placed {
    /// Positions in the LiDAR's frame at the reference time, m.
    pub qx: [f32; LANES],
    /// The same along y.
    pub qy: [f32; LANES],
    /// Positions from the local origin, m.
    pub wx: [f32; LANES],
    /// The same along y.
    pub wy: [f32; LANES],
}

/// Pose and velocity in single precision, measured from a local origin.
#[derive(Debug, Clone, Copy)]
pub struct LocalMotion {
    /// The origin.
    pub origin: LocalOrigin,
    x: f32,
    y: f32,
    pub cos: f32,
    pub sin: f32,
    vx: f32,
    vy: f32,
    omega: f32,
    /// Half the acceleration.
    half_ax: f32,
    half_ay: f32,
    half_alpha: f32,
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
            half_ax: 0.5 * motion.acceleration.x as f32,
            half_ay: 0.5 * motion.acceleration.y as f32,
            half_alpha: 0.5 * motion.acceleration.z as f32,
        }
    }

    /// The LiDAR's velocity in its own frame, m/s and rad/s.
    pub fn velocity(&self) -> (f32, f32, f32) {
        (self.vx, self.vy, self.omega)
    }

    /// The direction of a deskewed point from the LiDAR, as the map's axes lie.
    #[inline]
    pub fn direction(&self, x: f32, y: f32, inverse_range: f32) -> (f32, f32) {
        let (x, y) = (x * inverse_range, y * inverse_range);
        (self.cos * x - self.sin * y, self.sin * x + self.cos * y)
    }

    /// The LiDAR's position.
    pub fn position(&self) -> (f32, f32) {
        (self.x, self.y)
    }

    /// Deskews a point: where a beam taken at `tau` would have hit at the reference time.
    #[inline]
    pub fn deskew(&self, x: f32, y: f32, tau: f32) -> (f32, f32) {
        let a = tau * (self.omega + tau * self.half_alpha);
        let a2 = a * a;
        let s = a * (1.0 - a2 * (1.0 / 6.0 - a2 * (1.0 / 120.0)));
        let c = 1.0 - a2 * (0.5 - a2 * (1.0 / 24.0 - a2 * (1.0 / 720.0)));
        // (sin a)/a and (1 - cos a)/a of the exponential map.
        let sa = 1.0 - a2 * (1.0 / 6.0 - a2 * (1.0 / 120.0));
        let ca = a * (0.5 - a2 * (1.0 / 24.0));
        let tx = tau * (self.vx + tau * self.half_ax);
        let ty = tau * (self.vy + tau * self.half_ay);
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

    /// Places a block's points: in the LiDAR's frame at the reference time, and over the map.
    #[inline]
    pub fn place(&self, block: &Block) -> Placed {
        let mut placed = Placed {
            qx: [0.0; LANES],
            qy: [0.0; LANES],
            wx: [0.0; LANES],
            wy: [0.0; LANES],
        };
        for i in 0..LANES {
            let (qx, qy) = self.deskew(block.x[i], block.y[i], block.tau_s[i]);
            (placed.wx[i], placed.wy[i]) = self.transform(qx, qy);
            (placed.qx[i], placed.qy[i]) = (qx, qy);
        }
        placed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose2;
    use nalgebra::{Vector2, Vector3};

    #[test]
    fn deskewing_is_the_exponential_map() {
        let mut motion = Motion::starting_at(Pose2::new(3.0, -2.0, 0.4));
        motion.velocity = Vector3::new(1.3, -0.2, 1.1);
        let local = LocalMotion::new(&motion, LocalOrigin::near(3.0, -2.0));
        for tau in [-0.05, 0.0, 0.013, 0.05] {
            let moved = Pose2::exp(&(motion.velocity * tau));
            let wanted = moved.transform_point(Vector2::new(7.0, -4.0));
            let (x, y) = local.deskew(7.0, -4.0, tau as f32);
            assert!((f64::from(x) - wanted.x).abs() < 2e-6, "{x} {wanted}");
            assert!((f64::from(y) - wanted.y).abs() < 2e-6, "{y} {wanted}");
        }
    }
}
