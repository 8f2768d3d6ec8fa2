//! Watch over the LiDAR odometry: a corridor leaves its axis open, a hall without features everything.

use nalgebra::{Matrix3, Vector3};

use crate::lidar_odometry::OdometryPose;

/// Sigma along some direction from which a pose is a guess, m.
const GUESS_SIGMA_M: f64 = 0.05;
/// Sigma of the LiDAR's way along a direction that the scene leaves open, m.
const OPEN_SIGMA_M: f64 = 10.0;
/// Way on guesses after which a robot has lost its odometry, m.
const LOST_AFTER_M: f64 = 5.0;

/// Way of a robot since its LiDAR odometry knew its way.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct OdometryWatch {
    /// Distance (m) and time (s) of the session when it knew its way last.
    last_known: Option<(f64, f64)>,
    is_told: bool,
}

impl OdometryWatch {
    /// Notes a scan at this distance (m) and time (s) of the session. When the odometry becomes
    /// lost with it, returns the time since when.
    pub fn note(&mut self, is_guess: bool, distance_m: f64, time_s: f64) -> Option<f64> {
        let (last_m, last_s) = *self.last_known.get_or_insert((distance_m, time_s));
        if !is_guess || distance_m < last_m {
            *self = Self {
                last_known: Some((distance_m, time_s)),
                is_told: self.is_told && is_guess,
            };
            return None;
        }
        let becomes_lost = !self.is_told && distance_m - last_m > LOST_AFTER_M;
        self.is_told |= becomes_lost;
        becomes_lost.then_some(last_s)
    }

    /// True if it was reported that the odometry is lost, and it still is.
    pub fn is_told(self) -> bool {
        self.is_told
    }
}

/// True if a pose is not known along some direction.
pub(super) fn is_guess(pose: &OdometryPose) -> bool {
    let position = pose.covariance.fixed_view::<2, 2>(0, 0).into_owned();
    let variance_m2 = position.symmetric_eigenvalues().max();
    pose.unconstrained_rad.is_some() || variance_m2 > GUESS_SIGMA_M * GUESS_SIGMA_M
}

/// Covariance of a pose whose scene leaves a direction (rad, in the LiDAR's frame) open: the way
/// along it is wrong for as long as the direction is open, and not from scan to scan.
pub(super) fn of_open_direction(unconstrained_rad: Option<f64>) -> Matrix3<f64> {
    unconstrained_rad.map_or_else(Matrix3::zeros, |along_rad| {
        let (sin, cos) = along_rad.sin_cos();
        let along = Vector3::new(cos, sin, 0.0) * OPEN_SIGMA_M;
        along * along.transpose()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_of_guesses_is_told_once_until_the_odometry_knows_its_way() {
        let mut watch = OdometryWatch::default();
        let mut told = Vec::new();
        for step in 0..200 {
            let distance_m = 0.1 * f64::from(step);
            // Two open stretches: of 4 m, and of 8 m.
            let is_guess = (10..50).contains(&step) || (60..140).contains(&step);
            if let Some(since_s) = watch.note(is_guess, distance_m, f64::from(step)) {
                told.push((step, since_s));
            }
        }
        assert_eq!(told, [(110, 59.0)]);
        assert!(!watch.is_told());
    }

    #[test]
    fn a_corridor_says_nothing_of_the_way_along_it() {
        let covariance = of_open_direction(Some(0.5));
        let along = Vector3::new(0.5_f64.cos(), 0.5_f64.sin(), 0.0);
        let across = Vector3::new(-0.5_f64.sin(), 0.5_f64.cos(), 0.0);
        assert!(((along.transpose() * covariance * along)[0] - 100.0).abs() < 1e-9);
        assert!((covariance * across).norm() < 1e-12);
        assert_eq!(of_open_direction(None), Matrix3::zeros());
    }
}
