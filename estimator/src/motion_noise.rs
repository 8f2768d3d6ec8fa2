//! Process and measurement noise of the filter.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::drive_history::DriveSegment;
use crate::vehicle::Motion;

/// Noise of a driven metre. Densities: the variance grows with the distance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MotionNoise {
    /// Along the track, m per root metre: slip and speed noise.
    pub along_m_per_sqrt_m: f64,
    /// Across the track, m per root metre: side slip.
    pub across_m_per_sqrt_m: f64,
    /// Heading, rad per root metre: yaw slip.
    pub yaw_rad_per_sqrt_m: f64,
    /// Steering angle, rad times root metre: encoder steps and play, over their correlation length.
    pub steering_rad_sqrt_m: f64,
}

impl Default for MotionNoise {
    fn default() -> Self {
        Self {
            along_m_per_sqrt_m: 0.003,
            across_m_per_sqrt_m: 0.000_8,
            yaw_rad_per_sqrt_m: 0.000_25,
            steering_rad_sqrt_m: 0.000_4,
        }
    }
}

impl MotionNoise {
    /// Covariance that one step adds to the right perturbation at its end.
    ///
    /// A steering encoder with steps errs by up to half of one, and by the same all the while its
    /// reading stays: over `D` metres the turn then varies as `D^2`, so that the step from `D` to
    /// `D + d` adds `2 D d + d^2` times the variance of a reading, `step^2 / 12`.
    pub fn of_step(&self, motion: &Motion, segment: &DriveSegment) -> Matrix3<f64> {
        let distance_m = motion.speed_mps.abs() * segment.duration_s;
        // Along the track an error of the speed also turns: it scales the whole twist (v, 0, w). A
        // steering error of sigma over a metre turns by sigma * d(yaw)/d(steering) per metre.
        let (curvature_per_m, turn_per_m) = if motion.speed_mps.abs() > 1e-6 {
            (
                motion.yaw_rate_radps / motion.speed_mps,
                motion.yaw_rate_by_steering / motion.speed_mps,
            )
        } else {
            (0.0, 0.0)
        };
        let held = segment.steering_step_rad.powi(2) / 12.0 * (2.0 * segment.held_m + distance_m);
        let along = Vector3::new(1.0, 0.0, curvature_per_m) * self.along_m_per_sqrt_m;
        let yaw_density = self.yaw_rad_per_sqrt_m.powi(2)
            + (self.steering_rad_sqrt_m.powi(2) + held) * turn_per_m.powi(2);
        let others = Vector3::new(0.0, self.across_m_per_sqrt_m.powi(2), yaw_density);
        (along * along.transpose() + Matrix3::from_diagonal(&others)) * distance_m
    }
}
