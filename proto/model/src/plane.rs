//! Points and poses in the plane, SE(2).

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Wraps an angle into `(-pi, pi]`.
#[inline]
pub fn wrap_angle_rad(angle_rad: f64) -> f64 {
    let wrapped = angle_rad - TAU * ((angle_rad + PI) / TAU).floor();
    if wrapped <= -PI { PI } else { wrapped }
}

/// A point in the plane, in metres.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Point {
    /// Along x.
    pub x_m: f64,
    /// Along y.
    pub y_m: f64,
}

impl Point {
    /// Makes a point from metres.
    #[inline]
    pub const fn new(x_m: f64, y_m: f64) -> Self {
        Self { x_m, y_m }
    }

    /// Returns the distance to `other`, m.
    #[inline]
    pub fn distance_m(self, other: Self) -> f64 {
        (self.x_m - other.x_m).hypot(self.y_m - other.y_m)
    }

    /// Returns the point `fraction` of the way to `other`.
    #[must_use]
    #[inline]
    pub fn toward(self, other: Self, fraction: f64) -> Self {
        Self {
            x_m: self.x_m + fraction * (other.x_m - self.x_m),
            y_m: self.y_m + fraction * (other.y_m - self.y_m),
        }
    }
}

/// A pose in the plane.
// The pose of some frame `b` in a frame `a` is also the transform `a_from_b`. The comments of type
// and fields are the words of the OpenAPI document.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = PoseDocument))]
pub struct Pose2 {
    /// Position forward, m.
    pub x_m: f64,
    /// Position to the left, m.
    pub y_m: f64,
    /// Counter-clockwise, rad.
    // Not wrapped: it counts turns.
    pub yaw_rad: f64,
}

impl Pose2 {
    /// The frame itself: no translation, no rotation.
    pub const IDENTITY: Self = Self {
        x_m: 0.0,
        y_m: 0.0,
        yaw_rad: 0.0,
    };

    /// Makes a pose from metres and radians.
    #[inline]
    pub const fn new(x_m: f64, y_m: f64, yaw_rad: f64) -> Self {
        Self { x_m, y_m, yaw_rad }
    }

    /// Returns its position.
    #[inline]
    pub const fn point(&self) -> Point {
        Point::new(self.x_m, self.y_m)
    }

    /// Returns the pose `fraction` of the way to `other`, linear in each coordinate: for poses that
    /// are millimetres apart.
    #[must_use]
    #[inline]
    pub fn toward(&self, other: &Self, fraction: f64) -> Self {
        let point = self.point().toward(other.point(), fraction);
        let yaw_rad = self.yaw_rad + fraction * (other.yaw_rad - self.yaw_rad);
        Self::new(point.x_m, point.y_m, yaw_rad)
    }

    /// `a_from_c = a_from_b * b_from_c`.
    #[must_use]
    #[inline]
    pub fn compose(&self, b_from_c: &Self) -> Self {
        let (s, c) = self.yaw_rad.sin_cos();
        Self {
            x_m: self.x_m + c * b_from_c.x_m - s * b_from_c.y_m,
            y_m: self.y_m + s * b_from_c.x_m + c * b_from_c.y_m,
            yaw_rad: self.yaw_rad + b_from_c.yaw_rad,
        }
    }

    /// `b_from_a`.
    #[must_use]
    #[inline]
    pub fn inverse(&self) -> Self {
        let (s, c) = self.yaw_rad.sin_cos();
        Self {
            x_m: -c * self.x_m - s * self.y_m,
            y_m: s * self.x_m - c * self.y_m,
            yaw_rad: -self.yaw_rad,
        }
    }

    /// Motion from `self` to `other`, in the frame of `self`: `self^-1 * other`.
    #[must_use]
    #[inline]
    pub fn between(&self, other: &Self) -> Self {
        self.inverse().compose(other)
    }

    /// Transforms a point of `b` into `a`.
    #[inline]
    pub fn transform_point(&self, point_in_b: Vector2<f64>) -> Vector2<f64> {
        self.rotation() * point_in_b + self.translation()
    }

    /// Returns the rotation matrix of `a_from_b`.
    #[inline]
    pub fn rotation(&self) -> Matrix2<f64> {
        let (s, c) = self.yaw_rad.sin_cos();
        Matrix2::new(c, -s, s, c)
    }

    /// Returns the translation of `a_from_b`, in metres.
    #[inline]
    pub fn translation(&self) -> Vector2<f64> {
        Vector2::new(self.x_m, self.y_m)
    }

    /// Exponential map of a twist `(x, y, yaw)`: the arc driven with constant velocity.
    #[inline]
    pub fn exp(twist: &Vector3<f64>) -> Self {
        Self::arc(twist.x, twist.y, twist.z)
    }

    /// The arc of a constant body velocity: exponential map of `(x_m, y_m, yaw_rad)`.
    #[must_use]
    #[inline]
    pub fn arc(x_m: f64, y_m: f64, yaw_rad: f64) -> Self {
        let w = yaw_rad;
        // Series below 1e-5 rad: sin(w)/w and (1-cos(w))/w lose digits there.
        let (a, b) = if w.abs() < 1e-5 {
            (1.0 - w * w / 6.0, w / 2.0)
        } else {
            (w.sin() / w, (1.0 - w.cos()) / w)
        };
        Self {
            x_m: a * x_m - b * y_m,
            y_m: b * x_m + a * y_m,
            yaw_rad,
        }
    }

    /// Logarithm: the twist whose [`Pose2::exp`] is this pose. The yaw is wrapped.
    #[inline]
    pub fn log(&self) -> Vector3<f64> {
        let w = wrap_angle_rad(self.yaw_rad);
        let half = 0.5 * w;
        let a = if w.abs() < 1e-5 {
            1.0 - w * w / 12.0
        } else {
            half / half.tan()
        };
        Vector3::new(
            a * self.x_m + half * self.y_m,
            -half * self.x_m + a * self.y_m,
            w,
        )
    }

    /// Adjoint: maps a right (local) perturbation of `b` to one of `a`.
    #[inline]
    pub fn adjoint(&self) -> Matrix3<f64> {
        let (s, c) = self.yaw_rad.sin_cos();
        Matrix3::new(c, -s, self.y_m, s, c, -self.x_m, 0.0, 0.0, 1.0)
    }

    /// Returns the pose with its yaw in `(-pi, pi]`.
    #[must_use]
    #[inline]
    pub fn wrapped(&self) -> Self {
        Self {
            yaw_rad: wrap_angle_rad(self.yaw_rad),
            ..*self
        }
    }

    /// True if all three numbers are finite.
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.x_m.is_finite() && self.y_m.is_finite() && self.yaw_rad.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose() -> impl Strategy<Value = Pose2> {
        (-50.0..50.0, -50.0..50.0, -3.1..3.1).prop_map(|(x, y, yaw)| Pose2::new(x, y, yaw))
    }

    fn close(a: &Pose2, b: &Pose2) -> bool {
        (a.x_m - b.x_m).abs() < 1e-9
            && (a.y_m - b.y_m).abs() < 1e-9
            && wrap_angle_rad(a.yaw_rad - b.yaw_rad).abs() < 1e-9
    }

    proptest! {
        #[test]
        fn composing_with_the_inverse_gives_the_identity(p in pose()) {
            prop_assert!(close(&p.compose(&p.inverse()), &Pose2::IDENTITY));
        }

        #[test]
        fn exp_undoes_log(p in pose()) {
            prop_assert!(close(&Pose2::exp(&p.log()), &p));
        }

        #[test]
        fn adjoint_moves_a_local_perturbation_to_the_other_side(p in pose()) {
            let local = Vector3::new(1e-6, -2e-6, 3e-6);
            let right = p.compose(&Pose2::exp(&local));
            let left = Pose2::exp(&(p.adjoint() * local)).compose(&p);
            prop_assert!(close(&right, &left));
        }
    }

    #[test]
    fn wrapping_keeps_angles_in_the_half_open_turn() {
        assert!((wrap_angle_rad(3.0 * PI) - PI).abs() < 1e-12);
        assert!((wrap_angle_rad(-PI) - PI).abs() < 1e-12);
        assert!((wrap_angle_rad(0.3 - 4.0 * PI) - 0.3).abs() < 1e-12);
    }
}
