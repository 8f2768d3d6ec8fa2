//! Lean rows: of each robot what the fleet's list shows, once a second, and only what is new.

use std::collections::BTreeMap;

use fleetcal_domain::standing::Standing;
use fleetcal_model::{Parameter, ParameterStatus};
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::{EstimateDocument, ParameterDocument};
use serde::Serialize;

/// The parameters of a row, in the order of its lists.
const SHOWN: [Parameter; 4] = [
    Parameter::SteeringOffset,
    Parameter::LidarX,
    Parameter::LidarY,
    Parameter::LidarYaw,
];
/// A list shows a thousandth of a degree and a tenth of a millimetre; these are half of that, in
/// rad, m, m and rad.
const STEPS: [f64; 4] = [1e-5, 5e-5, 5e-5, 1e-5];
/// Distances are told to the metre.
const DISTANCE_STEP_M: f64 = 1.0;

/// What the fleet's list shows of a robot's estimate. Each list has steering offset (rad), LiDAR x
/// (m), y (m) and yaw (rad).
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
#[schema(as = RobotRow)]
pub(super) struct Row {
    robot: RobotId,
    /// How it stands, in one word.
    standing: Standing,
    /// Distance driven in this session, m.
    distance_m: f64,
    /// Values, to half of what a list shows: 0.0006° and 0.05 mm.
    #[schema(value_type = [f64; 4])]
    values: [f64; 4],
    /// Their standard deviations.
    #[schema(value_type = [f64; 4])]
    sigmas: [f64; 4],
    /// How far they are known.
    status: [ParameterStatus; 4],
    /// Which motion would make them better known; absent when nothing is missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    needs: Option<[Option<String>; 4]>,
}

impl Row {
    /// The row of an estimate of a robot that stands like this.
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

/// The rows that are to be told.
#[derive(Debug, Default)]
pub(super) struct Rows {
    /// As each robot's was told last.
    told: BTreeMap<RobotId, Row>,
    new: BTreeMap<RobotId, Row>,
}

impl Rows {
    /// Takes an estimate of a robot that stands like this.
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

    /// Takes how a robot stands now, which the row that is to be told says too.
    pub(super) fn take_standing(&mut self, robot: &RobotId, standing: Standing) {
        if let Some(row) = self.new.get_mut(robot) {
            row.standing = standing;
        }
    }

    /// Those that have changed since this was last asked.
    pub(super) fn take_new(&mut self) -> Vec<Row> {
        let new: Vec<Row> = std::mem::take(&mut self.new).into_values().collect();
        for row in &new {
            self.told.insert(row.robot.clone(), row.clone());
        }
        new
    }
}
