//! Route `GET /robots/{id}/checks`: the joining checks of a robot.

use axum::Json;
use axum::extract::State;
use fleetcal_domain::robot::{CheckFinding, CheckedStream, ChecksReport};
use fleetcal_proto::RobotId;
use serde::Serialize;

use crate::ApiState;
use crate::extract::{NoParameters, Parameters};
use crate::forwarding::OwnRobot;
use crate::problem::Problem;

/// Joining checks of a robot, as `fleetcal doctor --json` has them of a recording.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Checks)]
pub(super) struct ChecksDocument {
    /// Id of the robot.
    robot: RobotId,
    /// Way of the LiDAR while its motion was looked at, m.
    way_m: f64,
    /// True while only the streams are looked at, because nothing was found.
    resting: bool,
    /// Streams as they come; empty before the robot has sent data.
    streams: Vec<CheckedStream>,
    /// List of every cause that is named, and an entry for each check that names none.
    findings: Vec<CheckFinding>,
}

impl ChecksDocument {
    pub(super) fn of(robot: RobotId, report: &ChecksReport) -> Self {
        Self {
            robot,
            way_m: report.way_m,
            resting: report.resting,
            streams: report.streams.clone(),
            findings: report.findings.clone(),
        }
    }
}

/// Returns the joining checks of a robot: what is wrong with its messages.
#[utoipa::path(
    get,
    path = "/robots/{id}/checks",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot.")),
    responses(
        (status = OK, description = "The joining checks", body = ChecksDocument),
        (status = NOT_FOUND, description = "The robot is unknown"),
    )
)]
pub(super) async fn get_checks(
    State(api): State<ApiState>,
    OwnRobot(id): OwnRobot,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Json<ChecksDocument>, Problem> {
    let Some(view) = api.fleet.robot(&id) else {
        return Err(Problem::robot_unknown(id.as_str()));
    };
    Ok(Json(ChecksDocument::of(id, &view.checks)))
}
