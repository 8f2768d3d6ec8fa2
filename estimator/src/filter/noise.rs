//! Process and measurement noise of the filter.

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use crate::vehicle::Motion;

/// How far a driven metre can go astray. Densities: the variance grows with the distance.
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
            along_m_per_sqrt_m: 0.002,
            across_m_per_sqrt_m: 0.001,
            yaw_rad_per_sqrt_m: 0.000_3,
            steering_rad_sqrt_m: 0.000_8,
        }
    }
}

impl MotionNoise {
    /// Covariance that one step adds to the right perturbation at its end.
    pub fn of_step(&self, motion: &Motion, dt_s: f64) -> Matrix3<f64> {
        let distance_m = motion.speed_mps.abs() * dt_s;
        // A steering error of sigma over a metre turns by sigma * d(yaw)/d(steering) per metre.
        let turn_per_m = if motion.speed_mps.abs() > 1e-6 {
            motion.yaw_rate_by_steering / motion.speed_mps
        } else {
            0.0
        };
        let yaw_density =
            self.yaw_rad_per_sqrt_m.powi(2) + (self.steering_rad_sqrt_m * turn_per_m).powi(2);
        Matrix3::from_diagonal(&nalgebra::Vector3::new(
            self.along_m_per_sqrt_m.powi(2) * distance_m,
            self.across_m_per_sqrt_m.powi(2) * distance_m,
            yaw_density * distance_m,
        ))
    }
}
