//! What the scene says about the pose: the direction it leaves open, and how sure the rest is.

use nalgebra::{Matrix2, Matrix3, Matrix6, Vector2, Vector6};

use super::point_to_line::NormalEquations;

/// Only when one direction of translation is informed this much less than the other it is looked at.
const SUSPECT_RATIO: f64 = 0.03;
/// A direction in which the surfaces that face it fix the position no better than this is open, m.
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

    /// Takes what the equations say along the direction out of them: it is the noise of the map's
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

/// Whether `facing`, the information of the surfaces that face the direction, leaves it open.
pub fn is_open(facing: f64) -> bool {
    facing * OPEN_SIGMA_M * OPEN_SIGMA_M < 1.0
}

/// The covariance of the pose that is given out.
pub fn of_pose(filter: &Matrix6<f64>) -> Matrix3<f64> {
    filter.fixed_view::<3, 3>(0, 0).into_owned()
}
