//! Route `GET /robots/{id}/innovations`: the latest innovations of a robot's filter.

use axum::Json;
use axum::extract::State;
use fleetcal_domain::limits;
use fleetcal_model::Innovation;
use fleetcal_proto::RobotId;
use serde::Serialize;

use crate::ApiState;
use crate::extract::{NoParameters, Parameters};
use crate::forwarding::OwnRobot;
use crate::problem::Problem;

/// Latest innovations of a robot's filter, one of each second of driving.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Innovations)]
pub(super) struct InnovationsDocument {
    /// Id of the robot.
    robot: RobotId,
    /// Largest number that is kept; older ones are dropped.
    kept_max: usize,
    /// Innovations, oldest first.
    items: Vec<Innovation>,
}

/// Returns the latest innovations of a robot's filter with the standard deviations that its
/// configured noise implies: they are kept in memory since the service started.
#[utoipa::path(
    get,
    path = "/robots/{id}/innovations",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot.")),
    responses(
        (status = OK, description = "The innovations", body = InnovationsDocument),
        (status = NOT_FOUND, description = "The robot is unknown"),
        (status = SERVICE_UNAVAILABLE, description = "No instance has the robot"),
    )
)]
pub(super) async fn get_innovations(
    State(api): State<ApiState>,
    OwnRobot(id): OwnRobot,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Json<InnovationsDocument>, Problem> {
    let items = api.fleet.innovations(&id)?;
    Ok(Json(InnovationsDocument {
        robot: id,
        kept_max: limits::INNOVATIONS_KEPT,
        items,
    }))
}
