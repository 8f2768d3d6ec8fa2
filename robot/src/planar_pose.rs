//! A pose in the plane, as files and messages have it.

/// A pose in the plane.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PlanarPose {
    /// Forward, m.
    pub x_m: f64,
    /// To the left, m.
    pub y_m: f64,
    /// Counter-clockwise, rad.
    pub yaw_rad: f64,
}

impl PlanarPose {
    /// The pose, in the frame that this pose is in, of what is at `inner` in this pose's own.
    pub(crate) fn compose(self, inner: Self) -> Self {
        let (sine, cosine) = self.yaw_rad.sin_cos();
        Self {
            x_m: self.x_m + cosine * inner.x_m - sine * inner.y_m,
            y_m: self.y_m + sine * inner.x_m + cosine * inner.y_m,
            yaw_rad: self.yaw_rad + inner.yaw_rad,
        }
    }
}
