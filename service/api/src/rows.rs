//! Lean rows: the values of each robot in the fleet's list, once a second, and changed ones alone.

use std::collections::BTreeMap;

use fleetcal_domain::standing::Standing;
use fleetcal_model::{Parameter, ParameterStatus};
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::{EstimateDocument, ParameterDocument};
use serde::Serialize;

/// Parameters of a row, in the order of its lists.
const SHOWN: [Parameter; 4] = [
    Parameter::SteeringOffset,
    Parameter::LidarX,
    Parameter::LidarY,
    Parameter::LidarYaw,
];
/// Rounding steps of the values, rad, m, m and rad: half of a thousandth of a degree and of a tenth
/// of a millimetre, which a list shows.
const STEPS: [f64; 4] = [1e-5, 5e-5, 5e-5, 1e-5];
/// Rounding step of distances, m.
const DISTANCE_STEP_M: f64 = 1.0;

/// Row of a robot's estimate in the fleet's list. Each list has steering offset (rad), LiDAR x (m),
/// y (m) and yaw (rad).
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
#[schema(as = RobotRow)]
pub(super) struct Row {
    robot: RobotId,
    /// Standing of the robot, in one word.
    standing: Standing,
    /// Distance driven in this session, m.
    distance_m: f64,
    /// Values, rounded to half of the digits that a list shows: 0.0006° and 0.05 mm.
    #[schema(value_type = [f64; 4])]
    values: [f64; 4],
    /// Standard deviations of the values.
    #[schema(value_type = [f64; 4])]
    sigmas: [f64; 4],
    /// Status of each parameter.
    status: [ParameterStatus; 4],
    /// Motions that would improve each parameter; absent if none is needed.
    #[serde(skip_serializing_if = "Option::is_none")]
    needs: Option<[Option<String>; 4]>,
}

impl Row {
    /// Row of an estimate of a robot with this standing.
    pub(super) fn of(robot: &RobotId, standing: Standing, estimate: &EstimateDocument) -> Self {
        let shown = SHOWN.map(|name| estimate.parameters.get(name));
        let needs = shown.map(|parameter| parameter.needs.clone());
        let rounded_each = |part: fn(&ParameterDocument) -> f64| {
            let mut steps = STEPS.into_iter();
            shown.map(|parameter| rounded(part(parameter), steps.next().unwrap_or(1.0)))
        };
        Self {
            robot: robot.clone(),
            standing,
            distance_m: rounded(estimate.distance_m, DISTANCE_STEP_M),
            values: rounded_each(|parameter| parameter.value),
            sigmas: rounded_each(|parameter| parameter.sigma),
            status: shown.map(|parameter| parameter.status),
            needs: needs.iter().any(Option::is_some).then_some(needs),
        }
    }
}

fn rounded(value: f64, step: f64) -> f64 {
    let steps = (value / step).round();
    // A division gives the shortest decimal number; a product with the step would not.
    steps / (1.0 / step).round()
}

/// Rows to be sent.
#[derive(Debug, Default)]
pub(super) struct Rows {
    /// Row of each robot that was last sent.
    told: BTreeMap<RobotId, Row>,
    new: BTreeMap<RobotId, Row>,
}

impl Rows {
    /// Adds an estimate of a robot with this standing.
    pub(super) fn take(
        &mut self,
        robot: &RobotId,
        standing: Standing,
        estimate: &EstimateDocument,
    ) {
        let row = Row::of(robot, standing, estimate);
        if self.told.get(robot) == Some(&row) {
            self.new.remove(robot);
        } else {
            self.new.insert(robot.clone(), row);
        }
    }

    /// Updates the standing in the unsent row of a robot.
    pub(super) fn take_standing(&mut self, robot: &RobotId, standing: Standing) {
        if let Some(row) = self.new.get_mut(robot) {
            row.standing = standing;
        }
    }

    /// Removes and returns the rows that have changed since the last call.
    pub(super) fn take_new(&mut self) -> Vec<Row> {
        let new: Vec<Row> = std::mem::take(&mut self.new).into_values().collect();
        for row in &new {
            self.told.insert(row.robot.clone(), row.clone());
        }
        new
    }
}
