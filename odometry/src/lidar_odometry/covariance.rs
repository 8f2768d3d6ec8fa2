//! Covariance of a pose from the scene: the direction left open, and the certainty of the rest.

use nalgebra::{Matrix2, Matrix3, Matrix6, Vector2, Vector6};

use super::motion::Motion;
use super::normal_equations::NormalEquations;

/// Largest ratio of the information along two directions of translation at which the weaker one is
/// suspect.
const SUSPECT_RATIO: f64 = 0.03;
/// Smallest sigma of the position along a direction, by the surfaces that face it, at which it is
/// open, m.
const OPEN_SIGMA_M: f64 = 0.01;

/// A direction of translation, in the LiDAR's frame, that the scene leaves open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpenDirection {
    /// Unit vector in the LiDAR's frame.
    pub direction: Vector2<f64>,
}

impl OpenDirection {
    /// Its angle, rad.
    pub fn angle_rad(&self) -> f64 {
        self.direction.y.atan2(self.direction.x)
    }

    /// Projects the direction, in pose and velocity, out of a vector.
    fn keep(&self) -> Matrix6<f64> {
        let Vector2 { data, .. } = self.direction;
        let [[ex, ey]] = data.0;
        let pose = Vector6::new(ex, ey, 0.0, 0.0, 0.0, 0.0);
        let velocity = Vector6::new(0.0, 0.0, 0.0, ex, ey, 0.0);
        Matrix6::identity() - pose * pose.transpose() - velocity * velocity.transpose()
    }

    /// Removes the equations' information along the direction: it is the noise of the map's
    /// normals, which would hold the pose where it is.
    pub fn remove_from(&self, equations: &mut NormalEquations) {
        let keep = self.keep();
        equations.information = keep * equations.information * keep;
        equations.gradient = keep * equations.gradient;
    }

    /// A covariance without the correlations between the direction and the rest. Through them a
    /// direction that is off by its own noise would turn cross residuals of a millimetre into
    /// metres along the corridor.
    #[must_use]
    pub fn decouple(&self, covariance: &Matrix6<f64>) -> Matrix6<f64> {
        let keep = self.keep();
        let along = Matrix6::identity() - keep;
        keep * covariance * keep + along * covariance * along
    }
}

/// The weakest direction of translation, when it is weak enough to be suspect.
pub fn suspect_direction(equations: &NormalEquations) -> Option<Vector2<f64>> {
    let information: Matrix2<f64> = equations.information.fixed_view::<2, 2>(0, 0).into_owned();
    let eigen = information.symmetric_eigen();
    let (weak, strong) = if eigen.eigenvalues[0] < eigen.eigenvalues[1] {
        (0, 1)
    } else {
        (1, 0)
    };
    (eigen.eigenvalues[weak] < SUSPECT_RATIO * eigen.eigenvalues[strong])
        .then(|| eigen.eigenvectors.column(weak).into_owned())
}

/// True if `facing`, the information of the surfaces that face the direction, leaves it open.
pub fn is_open(facing: f64) -> bool {
    facing * OPEN_SIGMA_M * OPEN_SIGMA_M < 1.0
}

/// Covariance of the published pose, from the filter's.
///
/// An error is added that the points do not show: a changing acceleration bends the motion within
/// a rolling scan by half of its change times the mean square of the beams' times, `tau2_s2`.
///
/// What is not in it is the map's own error, which moves all scans alike while the same surfaces
/// are in sight. In the simulated warehouse the normalised error of a motion between two scans
/// (3 is expected) comes to 2.0 from one scan to the next, 2.8 over 1 s, 3.0 over 3 s and 3.3 over
/// 10 s; through aisles that are new at every turn to 1.9, 3.0, 3.4 and 5.7. So the errors of scans
/// are white to within a fifth over the few metres between a filter's anchors.
pub fn of_pose(motion: &Motion, predicted: &Motion, tau2_s2: f64) -> Matrix3<f64> {
    let mut covariance: Matrix3<f64> = motion.covariance.fixed_view::<3, 3>(0, 0).into_owned();
    let bend = (motion.acceleration - predicted.acceleration) * (0.5 * tau2_s2);
    for axis in 0..3 {
        covariance[(axis, axis)] += bend[axis] * bend[axis];
    }
    covariance
}

#[cfg(test)]
mod tests {
    use super::*;

    fn equations(information: &Matrix6<f64>) -> NormalEquations {
        NormalEquations {
            information: *information,
            gradient: Vector6::repeat(1.0),
            on_map: 0.0,
            chi2: 0.0,
        }
    }

    #[test]
    fn the_weak_direction_of_a_corridor_is_suspect_and_a_room_has_none() {
        let (s, c) = 0.3_f64.sin_cos();
        let across = Vector2::new(-s, c);
        let mut information = Matrix6::identity();
        let corridor = across * across.transpose() * 1e6 + Matrix2::identity() * 1e3;
        information
            .fixed_view_mut::<2, 2>(0, 0)
            .copy_from(&corridor);
        let direction = suspect_direction(&equations(&information)).unwrap();
        assert!(direction.dot(&across).abs() < 1e-9);
        assert!(suspect_direction(&equations(&Matrix6::identity())).is_none());
        assert!(is_open(0.5e4) && !is_open(2e4));
    }

    #[test]
    fn what_is_removed_is_gone_and_the_rest_is_left() {
        let open = OpenDirection {
            direction: Vector2::new(0.6, 0.8),
        };
        let mut removed = equations(&Matrix6::identity());
        open.remove_from(&mut removed);
        let along = Vector6::new(0.6, 0.8, 0.0, 0.0, 0.0, 0.0);
        let across = Vector6::new(-0.8, 0.6, 0.0, 0.0, 0.0, 0.0);
        assert!((removed.information * along).norm() < 1e-12);
        assert!((removed.information * across - across).norm() < 1e-12);
        assert!(removed.gradient.dot(&along).abs() < 1e-12);
        let coupled = Matrix6::from_fn(|i, j| if i == j { 2.0 } else { 0.5 });
        let decoupled = open.decouple(&coupled);
        assert!((across.transpose() * decoupled * along)[0].abs() < 1e-12);
        let kept = (along.transpose() * decoupled * along)[0];
        assert!((kept - (along.transpose() * coupled * along)[0]).abs() < 1e-12);
    }
}
