//! The engine's own motion: pose and velocity of the LiDAR, predicted from scan to scan.
//!
//! The model is constant velocity under random acceleration, so wide that it decides nothing where
//! the scene does: a scan's pose is known to a millimetre, the prediction to a centimetre. It
//! knows nothing of wheels, steering or where the LiDAR sits.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use super::normal_equations::NormalEquations;
use crate::geometry::Pose2;

/// Standard deviation of the acceleration between scans, m/s².
const ACCELERATION_MPS2: f64 = 2.0;
/// Standard deviation of the angular acceleration between scans, rad/s².
const ANGULAR_ACCELERATION_RADPS2: f64 = 3.0;
/// Standard deviation of an unknown speed, m/s.
const SPEED_UNKNOWN_MPS: f64 = 1.5;
/// Standard deviation of an unknown angular speed, rad/s.
const ANGULAR_SPEED_UNKNOWN_RADPS: f64 = 1.0;

/// Acceleration is not estimated over longer intervals, s.
const ACCELERATION_INTERVAL_MAX_S: f64 = 0.35;
/// Largest acceleration within a scan, m/s² and rad/s².
const ACCELERATION_MAX: f64 = 4.0;

/// Pose and velocity of the LiDAR. Perturbations are the LiDAR's own (right): 0..3 of the pose,
/// 3..6 of the velocity.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// Pose in the odometry frame.
    pub pose: Pose2,
    /// Velocity (m/s, m/s, rad/s) in the LiDAR's frame.
    pub velocity: Vector3<f64>,
    /// Acceleration since the last scan (m/s², m/s², rad/s²): 1 m/s² and 1 rad/s² bend the motion to either end
    /// of a scan of 0.1 s by 1.3 mm and 0.07°, and of one of 0.2 s by 5 mm and 0.3°.
    pub acceleration: Vector3<f64>,
    /// True if it is predicted from a scan before.
    is_known: bool,
    /// Start of the acceleration; without it there is none.
    before: Option<Before>,
    /// Covariance of pose and velocity.
    pub covariance: Matrix6<f64>,
}

/// The velocity at the scan before.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Before {
    /// Velocity (m/s, m/s, rad/s) in the LiDAR's frame.
    velocity: Vector3<f64>,
    /// Time since then, s.
    interval_s: f64,
}

impl Motion {
    /// Begins at a known pose, with an unknown velocity.
    pub fn starting_at(pose: Pose2) -> Self {
        let mut covariance = Matrix6::zeros();
        for (index, sigma) in [
            1e-4,
            1e-4,
            1e-5,
            SPEED_UNKNOWN_MPS,
            SPEED_UNKNOWN_MPS,
            ANGULAR_SPEED_UNKNOWN_RADPS,
        ]
        .into_iter()
        .enumerate()
        {
            covariance[(index, index)] = sigma * sigma;
        }
        Self {
            pose,
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            is_known: false,
            before: None,
            covariance,
        }
    }

    /// Begins at a pose found by search, known only roughly, with an unknown velocity. The velocity
    /// at the scan before is that of `tracked`, the prediction of a LiDAR that is not lost: without
    /// it, the acceleration within the scan would count as zero.
    pub fn searched(pose: Pose2, tracked: Option<&Self>) -> Self {
        let mut motion = Self::starting_at(pose);
        motion.before = tracked.and_then(|tracked| tracked.before);
        for (index, sigma) in [0.3, 0.3, 0.1].into_iter().enumerate() {
            motion.covariance[(index, index)] = sigma * sigma;
        }
        motion
    }

    /// One sigma of the position along its best known axis, m, and of the yaw, rad. A corridor's
    /// axis does not count.
    pub fn pose_sigmas(&self) -> (f64, f64) {
        let [least, _] = self.position_variances();
        (least.max(0.0).sqrt(), self.covariance[(2, 2)].sqrt())
    }

    /// One sigma of the position along its least known axis, m, and of the yaw, rad: what lies beyond
    /// some of them is not expected anywhere.
    pub fn pose_reach(&self) -> (f64, f64) {
        let [_, most] = self.position_variances();
        (most.max(0.0).sqrt(), self.covariance[(2, 2)].sqrt())
    }

    /// Variances of the position along its principal axes, the smaller first, m^2.
    fn position_variances(&self) -> [f64; 2] {
        let (xx, xy, yy) = (
            self.covariance[(0, 0)],
            self.covariance[(0, 1)],
            self.covariance[(1, 1)],
        );
        let (mean, half) = (0.5 * (xx + yy), (0.25 * (xx - yy).powi(2) + xy * xy).sqrt());
        [mean - half, mean + half]
    }

    /// True if there was a scan before to know the velocity from.
    pub fn is_known(&self) -> bool {
        self.is_known
    }

    /// Motion of a LiDAR that stands still, no surer of its pose than that it lies within these of
    /// the prediction.
    #[must_use]
    pub fn lost(&self, reach_m: f64, yaw_rad: f64) -> Self {
        let mut lost = Self::starting_at(self.pose);
        for (index, sigma) in [reach_m, reach_m, yaw_rad].into_iter().enumerate() {
            let variance = self.covariance[(index, index)].max(sigma * sigma);
            lost.covariance[(index, index)] = variance;
        }
        lost
    }

    /// The motion `dt` seconds later.
    #[must_use]
    pub fn predicted(&self, dt: f64) -> Self {
        let step = Pose2::exp(&(self.velocity * dt));
        let mut transition = Matrix6::identity();
        transition
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&step.inverse().adjoint());
        transition
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&(Matrix3::identity() * dt));
        let mut covariance = transition * self.covariance * transition.transpose();
        let accelerations = [
            ACCELERATION_MPS2,
            ACCELERATION_MPS2,
            ANGULAR_ACCELERATION_RADPS2,
        ];
        for (axis, sigma) in accelerations.into_iter().enumerate() {
            let variance = sigma * sigma * dt * dt;
            covariance[(axis, axis)] += 0.25 * variance * dt * dt;
            covariance[(axis, axis + 3)] += 0.5 * variance * dt;
            covariance[(axis + 3, axis)] += 0.5 * variance * dt;
            covariance[(axis + 3, axis + 3)] += variance;
        }
        Self {
            pose: self.pose.compose(&step),
            velocity: self.velocity,
            acceleration: self.acceleration,
            is_known: true,
            before: Some(Before {
                velocity: self.velocity,
                interval_s: dt,
            }),
            covariance,
        }
    }

    /// One Gauss-Newton step from the linearisation point `at` under the prediction `self`.
    /// Returns the correction and the covariance after it; `None` when the equations are singular.
    pub fn step(
        &self,
        information: &Matrix6<f64>,
        at: &Self,
        equations: &NormalEquations,
    ) -> Option<(Vector6<f64>, Matrix6<f64>)> {
        let pose = self.pose.between(&at.pose).log();
        let velocity = at.velocity - self.velocity;
        let moved = Vector6::new(pose.x, pose.y, pose.z, velocity.x, velocity.y, velocity.z);
        let covariance = (information + equations.information).cholesky()?.inverse();
        let correction = covariance * (equations.gradient - information * moved);
        Some((correction, covariance))
    }

    /// Applies a correction to the motion aligned so far under the prediction `self`.
    pub fn correct(&self, at: &mut Self, correction: &Vector6<f64>) {
        let twist = Vector3::new(correction[0], correction[1], correction[2]);
        at.pose = at.pose.compose(&Pose2::exp(&twist));
        at.velocity += Vector3::new(correction[3], correction[4], correction[5]);
        at.acceleration = self.acceleration_towards(&at.velocity);
    }

    /// The acceleration from the last scan's velocity to this one's.
    fn acceleration_towards(&self, velocity: &Vector3<f64>) -> Vector3<f64> {
        let near = |before: &Before| before.interval_s < ACCELERATION_INTERVAL_MAX_S;
        let Some(before) = self.before.filter(near) else {
            return Vector3::zeros();
        };
        let acceleration = (velocity - before.velocity) / before.interval_s;
        acceleration.map(|a| a.clamp(-ACCELERATION_MAX, ACCELERATION_MAX))
    }

    /// Inverse of the covariance.
    pub fn information(&self) -> Option<Matrix6<f64>> {
        Some(self.covariance.cholesky()?.inverse())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prediction_drives_the_arc_and_grows_less_sure() {
        let mut motion = Motion::starting_at(Pose2::new(1.0, 2.0, 0.3));
        motion.velocity = Vector3::new(1.0, 0.0, 0.5);
        let predicted = motion.predicted(0.2);
        let wanted = motion
            .pose
            .compose(&Pose2::exp(&Vector3::new(0.2, 0.0, 0.1)));
        assert_eq!(predicted.pose, wanted);
        let difference = predicted.covariance - predicted.covariance.transpose();
        assert!(difference.amax() < 1e-15);
        assert!(predicted.covariance.cholesky().is_some());
        assert!(predicted.pose_sigmas().0 > motion.pose_sigmas().0);
    }

    #[test]
    fn a_step_weighs_the_points_against_the_prediction() {
        let mut predicted = Motion::starting_at(Pose2::IDENTITY);
        predicted.covariance = Matrix6::identity() * 0.04;
        // The points say x = 1 with as much information as the prediction says x = 0.
        let mut equations = NormalEquations {
            information: Matrix6::zeros(),
            gradient: Vector6::zeros(),
            on_map: 0.0,
            chi2: 0.0,
        };
        equations.information[(0, 0)] = 25.0;
        equations.gradient[0] = 25.0;
        let information = predicted.information().unwrap();
        let (correction, covariance) = predicted
            .step(&information, &predicted, &equations)
            .unwrap();
        assert!((correction[0] - 0.5).abs() < 1e-12);
        assert!((covariance[(0, 0)] - 0.02).abs() < 1e-12);
        assert!((covariance[(1, 1)] - 0.04).abs() < 1e-12);
    }
}
