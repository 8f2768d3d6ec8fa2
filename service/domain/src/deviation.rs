//! Deviation of a robot's estimate from the calibration in use, in tolerances of the policy.

use fleetcal_model::{Parameter, ParameterStatus};
use fleetcal_proto::calibration::CalibrationValues;
use serde::Serialize;

use crate::approval::{RobotLedger, Tolerance, difference};
use crate::robot::RobotView;

/// Parameters that are compared, in the order of [`crate::approval::Change`].
const FOUR: [Parameter; 4] = [
    Parameter::SteeringOffset,
    Parameter::LidarX,
    Parameter::LidarY,
    Parameter::LidarYaw,
];

/// Deviation of one of the four values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Part {
    /// The value.
    parameter: Parameter,
    /// Status of its estimate.
    pub(crate) status: ParameterStatus,
    /// Estimate minus the value in use, in tolerances.
    tolerances: f64,
}

impl Part {
    /// True if the value is outside the tolerance.
    pub(crate) fn is_beyond(&self) -> bool {
        self.tolerances.abs() > 1.0
    }
}

/// Deviations of the four values of a robot's last estimate, known or not; `None` without an
/// estimate or while the values in use are unknown.
pub(crate) fn parts(
    view: &RobotView,
    ledger: &RobotLedger,
    tolerance: &Tolerance,
) -> Option<[Part; 4]> {
    let parameters = &view.estimate.as_deref()?.parameters;
    let in_use = ledger.shadow.in_use.as_ref()?;
    let [steering_offset_rad, lidar_x_m, lidar_y_m, lidar_yaw_rad] =
        FOUR.map(|one| parameters.get(one).value);
    let estimated = CalibrationValues {
        steering_offset_rad,
        lidar_x_m,
        lidar_y_m,
        lidar_yaw_rad,
        ..CalibrationValues::default()
    };
    let change = difference(&in_use.values, &estimated);
    let limits = tolerance.limits();
    Some(std::array::from_fn(|index| Part {
        parameter: FOUR[index],
        status: parameters.get(FOUR[index]).status,
        tolerances: change[index] / limits[index],
    }))
}

/// Deviation of a robot's estimate from the calibration in use: that of the value which is
/// farthest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Deviation {
    /// Distance of the estimate from the value in use, in tolerances (`propose_beyond` of the
    /// policy).
    pub tolerances: f64,
    /// Value that is farthest.
    pub parameter: Parameter,
}

impl Deviation {
    /// Deviation of a robot; `None` while no converged value can be compared with a value in use.
    pub fn of(view: &RobotView, ledger: &RobotLedger, tolerance: &Tolerance) -> Option<Self> {
        let parts = parts(view, ledger, tolerance)?.into_iter();
        let known = parts.filter(|part| part.status == ParameterStatus::Converged);
        let sizes = known.map(|part| Self {
            tolerances: part.tolerances.abs(),
            parameter: part.parameter,
        });
        sizes.reduce(|farthest, one| {
            if one.tolerances > farthest.tolerances {
                one
            } else {
                farthest
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use fleetcal_model::Generation;

    use super::*;
    use crate::alert::tests::{estimate, in_use, robot, view};
    use crate::approval::Policy;

    #[test]
    fn it_is_that_of_the_known_value_which_is_farthest() {
        let tolerance = Policy::default().propose_beyond;
        let mut view = view();
        let mut ledger = RobotLedger::new(robot());
        let of = |view: &RobotView, ledger: &RobotLedger| Deviation::of(view, ledger, &tolerance);
        assert_eq!(of(&view, &ledger), None, "nobody knows what it uses");
        let offset_rad = -3.0 * tolerance.limits()[0];
        ledger.shadow.in_use = Some(in_use(Generation(1), offset_rad));
        let found = of(&view, &ledger).unwrap();
        assert!((found.tolerances - 3.0).abs() < 1e-9, "{found:?}");
        assert_eq!(found.parameter, Parameter::SteeringOffset);
        view.estimate = Some(Arc::new(estimate(0.0, 0.1, "learning")));
        let known = of(&view, &ledger);
        assert!(known.is_none_or(|one| one.parameter != Parameter::SteeringOffset));
        view.estimate = None;
        assert_eq!(of(&view, &ledger), None);
    }
}
