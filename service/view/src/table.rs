//! The list of robots as a table.

use fleetcal_domain::deviation::Deviation;
use fleetcal_domain::robot::{ConnectionState, RobotView};
use fleetcal_domain::timestamp;
use fleetcal_model::{Label, Parameter, ParameterStatus, VehicleModel};

use crate::properties::Properties;

/// Headings of the columns. Angles are radians, lengths metres.
pub const COLUMNS: [&str; 16] = [
    "id",
    "site",
    "type",
    "tags",
    "model",
    "state",
    "standing",
    "connection",
    "in_maintenance",
    "last_seen",
    "deviation_tolerances",
    "deviation_parameter",
    "steering_offset_rad",
    "lidar_x_m",
    "lidar_y_m",
    "lidar_yaw_rad",
];

/// Fields of a robot, in the order of [`COLUMNS`]; empty where nothing is known.
pub fn fields(
    view: &RobotView,
    robot: &Properties,
    deviation: Option<Deviation>,
) -> [String; COLUMNS.len()] {
    let text = |known: Option<&str>| known.unwrap_or_default().to_owned();
    let tags: Vec<&str> = robot.tags.iter().map(Label::as_str).collect();
    let converged = |name: Parameter| {
        let parameter = view.estimate.as_deref()?.parameters.get(name);
        (parameter.status == ParameterStatus::Converged).then(|| parameter.value.to_string())
    };
    let converged = |name| converged(name).unwrap_or_default();
    [
        robot.id.to_owned(),
        text(robot.site.map(Label::as_str)),
        text(robot.vehicle_type.map(Label::as_str)),
        tags.join("; "),
        text(robot.model.map(VehicleModel::name)),
        robot.state.name().to_owned(),
        robot.standing.as_str().to_owned(),
        ConnectionState::of(robot.is_stale, false).name().to_owned(),
        robot.in_maintenance.to_string(),
        view.connection
            .last_heard()
            .map_or_else(String::new, |heard| timestamp::of(heard).to_string()),
        deviation.map_or_else(String::new, |one| format!("{:.3}", one.tolerances)),
        text(deviation.map(|one| one.parameter.name())),
        converged(Parameter::SteeringOffset),
        converged(Parameter::LidarX),
        converged(Parameter::LidarY),
        converged(Parameter::LidarYaw),
    ]
}
