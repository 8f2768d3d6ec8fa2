//! Points and poses in the plane.

use std::f64::consts::{PI, TAU};

use serde::{Deserialize, Serialize};

/// An angle brought into `(-pi, pi]`.
pub(crate) fn wrap_angle_rad(angle_rad: f64) -> f64 {
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
    /// A point from metres.
    pub const fn new(x_m: f64, y_m: f64) -> Self {
        Self { x_m, y_m }
    }

    /// The distance to `other`, m.
    pub fn distance_m(self, other: Self) -> f64 {
        (self.x_m - other.x_m).hypot(self.y_m - other.y_m)
    }

    /// The point `fraction` of the way to `other`.
    #[must_use]
    pub fn toward(self, other: Self, fraction: f64) -> Self {
        Self {
            x_m: self.x_m + fraction * (other.x_m - self.x_m),
            y_m: self.y_m + fraction * (other.y_m - self.y_m),
        }
    }
}

/// A pose in the plane: the pose of some frame `b` in a frame `a`, which is also `a_from_b`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose2 {
    /// Position along x of `a`, m.
    pub x_m: f64,
    /// Position along y of `a`, m.
    pub y_m: f64,
    /// Heading in `a`, counter-clockwise, rad. Not wrapped: it counts turns.
    pub yaw_rad: f64,
}

impl Pose2 {
    /// A pose from metres and radians.
    pub const fn new(x_m: f64, y_m: f64, yaw_rad: f64) -> Self {
        Self { x_m, y_m, yaw_rad }
    }

    /// Its position.
    pub const fn point(&self) -> Point {
        Point::new(self.x_m, self.y_m)
    }

    /// `a_from_c = a_from_b * b_from_c`.
    #[must_use]
    pub fn compose(&self, b_from_c: &Self) -> Self {
        let (sin, cos) = self.yaw_rad.sin_cos();
        Self {
            x_m: self.x_m + cos * b_from_c.x_m - sin * b_from_c.y_m,
            y_m: self.y_m + sin * b_from_c.x_m + cos * b_from_c.y_m,
            yaw_rad: self.yaw_rad + b_from_c.yaw_rad,
        }
    }

    /// `b_from_a`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let (sin, cos) = self.yaw_rad.sin_cos();
        Self {
            x_m: -cos * self.x_m - sin * self.y_m,
            y_m: sin * self.x_m - cos * self.y_m,
            yaw_rad: -self.yaw_rad,
        }
    }

    /// The motion from `self` to `other`, seen from `self`.
    #[must_use]
    pub fn between(&self, other: &Self) -> Self {
        self.inverse().compose(other)
    }

    /// The exact arc of a constant body velocity: exponential map of `(x, y, yaw)`.
    #[must_use]
    pub fn arc(x_m: f64, y_m: f64, yaw_rad: f64) -> Self {
        // Series below 1e-5 rad: sin(w)/w and (1-cos(w))/w lose digits there.
        let (along, across) = if yaw_rad.abs() < 1e-5 {
            (1.0 - yaw_rad * yaw_rad / 6.0, yaw_rad / 2.0)
        } else {
            (yaw_rad.sin() / yaw_rad, (1.0 - yaw_rad.cos()) / yaw_rad)
        };
        Self {
            x_m: along * x_m - across * y_m,
            y_m: across * x_m + along * y_m,
            yaw_rad,
        }
    }

    /// The pose `fraction` of the way to `other`, linear in each coordinate: for poses that are
    /// millimetres apart.
    #[must_use]
    pub(crate) fn toward(&self, other: &Self, fraction: f64) -> Self {
        let point = self.point().toward(other.point(), fraction);
        let yaw_rad = self.yaw_rad + fraction * (other.yaw_rad - self.yaw_rad);
        Self {
            x_m: point.x_m,
            y_m: point.y_m,
            yaw_rad,
        }
    }
}
