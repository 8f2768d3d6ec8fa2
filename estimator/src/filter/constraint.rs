//! Motion-based calibration constraint, `B X = X Z` (the paper's equation 6), and its
//! derivatives.
//!
//! In the compact form with `X = lidar_in_base`. The paper's expanded equations belong to the
//! inverse of `X`.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::prediction::{ByTimeShift, PredictedMotion, speed_noise_mps};
use super::{DRIVE_PARAMETER, PARAMETERS};
use crate::estimate::Parameter;
use crate::geometry::Pose2;
use crate::motion_noise::MotionNoise;

/// Derivatives of the LiDAR's motion by the calibration parameters.
pub type ByParameters = SMatrix<f64, 3, PARAMETERS>;

/// The LiDAR's motion that a body's motion makes, with derivatives of its right perturbation.
#[derive(Debug, Clone, Copy)]
pub struct LidarMotion {
    /// `h = X^-1 B X`.
    pub end_in_begin: Pose2,
    /// Derivatives by the right perturbation of the body's motion: `Ad(X^-1)`.
    pub by_body: Matrix3<f64>,
    /// A right perturbation of the LiDAR at the beginning, carried to the end: `Ad(h^-1)`.
    pub carry: Matrix3<f64>,
    /// Derivatives by x, y and yaw of the mount.
    pub by_mount: Matrix3<f64>,
}

impl LidarMotion {
    /// The motion of a LiDAR mounted at `lidar_in_base` on a body that moves by `body`.
    pub fn new(lidar_in_base: &Pose2, body: &Pose2) -> Self {
        let end_in_begin = lidar_in_base.inverse().compose(body).compose(lidar_in_base);
        let carry = end_in_begin.inverse().adjoint();
        // The mount's right perturbation is its additive one turned into the LiDAR's frame.
        let (s, c) = lidar_in_base.yaw_rad.sin_cos();
        let turned = Matrix3::new(c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0);
        Self {
            end_in_begin,
            by_body: lidar_in_base.inverse().adjoint(),
            carry,
            by_mount: (Matrix3::identity() - carry) * turned,
        }
    }

    /// Derivatives by all calibration parameters, for a motion that began exactly known.
    pub fn by_parameters(
        &self,
        motion: &PredictedMotion,
        twist_at_begin: &Vector3<f64>,
        noise: &MotionNoise,
    ) -> ByParameters {
        let mut by = ByParameters::zeros();
        for (column, parameter) in DRIVE_PARAMETER.iter().enumerate() {
            by.set_column(
                *parameter,
                &(self.by_body * motion.by_parameters.column(column)),
            );
        }
        by.fixed_view_mut::<3, 3>(0, Parameter::LidarX.index())
            .copy_from(&self.by_mount);
        by.set_column(
            Parameter::TimeOffset.index(),
            &(self.by_body
                * ByTimeShift::of(motion).between(
                    (twist_at_begin.x, motion.twist.x),
                    speed_noise_mps(noise, &motion.twist),
                )),
        );
        by
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The paper's expanded form, corrected: `a = theta_0 + theta_off`, with `theta_0 = 0`.
    fn expanded(x: &Pose2, body: &Pose2) -> Pose2 {
        let (s, c) = x.yaw_rad.sin_cos();
        let (sin, cos) = body.yaw_rad.sin_cos();
        let px = (cos - 1.0) * x.x_m - sin * x.y_m;
        let py = sin * x.x_m + (cos - 1.0) * x.y_m;
        Pose2::new(
            c * px + s * py + c * body.x_m + s * body.y_m,
            -s * px + c * py - s * body.x_m + c * body.y_m,
            body.yaw_rad,
        )
    }

    fn pose(metres: f64) -> impl Strategy<Value = Pose2> {
        (-metres..metres, -metres..metres, -3.0..3.0)
            .prop_map(|(x_m, y_m, yaw_rad)| Pose2::new(x_m, y_m, yaw_rad))
    }

    proptest! {
        #[test]
        fn the_expanded_form_equals_the_compact_one(x in pose(2.0), body in pose(10.0)) {
            let compact = LidarMotion::new(&x, &body).end_in_begin;
            let apart = compact.between(&expanded(&x, &body)).log();
            prop_assert!(apart.norm() < 1e-9, "{}", apart);
        }

        #[test]
        fn the_mounts_derivatives_match_differences(x in pose(2.0), body in pose(3.0)) {
            let motion = LidarMotion::new(&x, &body);
            let h = 1e-6;
            for (column, moved) in [
                Pose2::new(x.x_m + h, x.y_m, x.yaw_rad),
                Pose2::new(x.x_m, x.y_m + h, x.yaw_rad),
                Pose2::new(x.x_m, x.y_m, x.yaw_rad + h),
            ].iter().enumerate() {
                let other = LidarMotion::new(moved, &body).end_in_begin;
                let numeric = motion.end_in_begin.between(&other).log() / h;
                let analytic = motion.by_mount.column(column).into_owned();
                prop_assert!((numeric - analytic).norm() < 1e-4);
            }
        }
    }

    #[test]
    fn a_lidar_ahead_of_the_axle_moves_left_in_a_left_turn() {
        let turn = Pose2::exp(&Vector3::new(0.5, 0.0, 0.3));
        let motion = LidarMotion::new(&Pose2::new(0.434, 0.0, 0.0), &turn);
        assert!(motion.end_in_begin.y_m > turn.y_m && motion.end_in_begin.y_m > 0.0);
    }
}
