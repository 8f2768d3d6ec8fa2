//! Route `POST /robots/{id}/preview`: messages of an unregistered robot by a configuration that is not
//! stored.

use axum::Json;
use axum::extract::State;
use fleetcal_domain::robot::RobotConfig;
use fleetcal_proto::RobotId;
use serde::Serialize;

use super::checks::ChecksDocument;
use super::registration::{check_config, prefixes};
use super::top_view::TopViewDocument;
use crate::ApiState;
use crate::extract::{Body, NoParameters, Parameters, RobotPath};
use crate::problem::Problem;

/// Content of an unregistered robot's messages, by a configuration that is not stored.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Preview)]
pub(super) struct PreviewDocument {
    /// Joining checks of its messages.
    checks: ChecksDocument,
    /// Top view; null before the robot's first scan or pose.
    #[schema(nullable, required = true)]
    top_view: Option<TopViewDocument>,
    /// Messages that were dropped because too many came between two requests.
    dropped: u64,
}

/// Reads the messages of an unregistered robot by this configuration, and stores nothing.
///
/// The robot's messages are kept from the first request on, and from the first with another
/// configuration; 15 s after the last request they are dropped. Ask every second or two.
#[utoipa::path(
    post,
    path = "/robots/{id}/preview",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot.")),
    request_body = RobotConfig,
    responses(
        (status = OK, description = "The preview", body = PreviewDocument),
        (status = CONFLICT, description = "The robot is registered"),
        (status = INTERNAL_SERVER_ERROR, description = "Its messages could not be read"),
        (status = NOT_FOUND, description = "The robot is unknown"),
        (status = SERVICE_UNAVAILABLE,
            description = "Four other robots have a preview, or another instance receives the robot"),
    )
)]
pub(super) async fn preview_robot(
    State(api): State<ApiState>,
    RobotPath(id): RobotPath,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    Body { value: config, .. }: Body<RobotConfig>,
) -> Result<Json<PreviewDocument>, Problem> {
    check_config(&api, &prefixes(&api), &id, &config)?;
    let (fleet, robot) = (api.fleet.clone(), id.clone());
    let read = tokio::task::spawn_blocking(move || fleet.preview(&robot, config));
    let preview = read.await.map_err(|_| Problem::panicked())??;
    Ok(Json(PreviewDocument {
        checks: ChecksDocument::of(id, &preview.checks),
        top_view: preview.top_view.as_ref().map(TopViewDocument::of),
        dropped: preview.dropped,
    }))
}
