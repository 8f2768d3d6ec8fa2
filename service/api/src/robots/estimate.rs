//! Route `GET /robots/{id}/estimate`: a robot's present calibration.

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::EstimateDocument;

use crate::ApiState;
use crate::etag::tagged_json;
use crate::extract::{NoParameters, Parameters, RobotPath};
use crate::problem::Problem;

/// Returns a robot's present calibration: the document that is also on `{root}/{robot}/estimate`.
#[utoipa::path(
    get,
    path = "/robots/{id}/estimate",
    tag = "robots",
    params(
        ("id" = RobotId, Path, description = "The robot."),
        ("If-None-Match" = Option<String>, Header, description = "The ETag of an earlier answer."),
    ),
    responses(
        (status = OK, description = "The estimate", body = EstimateDocument,
            headers(("ETag" = String, description = "Changes with the estimate."))),
        (status = NOT_MODIFIED, description = "The client has the current estimate"),
        (status = NOT_FOUND, description = "The robot is unknown, or has no estimate yet"),
    )
)]
pub(super) async fn get_estimate(
    State(api): State<ApiState>,
    RobotPath(id): RobotPath,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let view = api
        .fleet
        .robot(&id)
        .ok_or_else(|| Problem::robot_unknown(id.as_str()))?;
    let estimate = view.estimate.ok_or_else(|| {
        let detail = format!("robot {id} has no estimate yet");
        Problem::new(StatusCode::NOT_FOUND, "estimate_missing", detail)
    })?;
    tagged_json(&headers, estimate.as_ref())
}
