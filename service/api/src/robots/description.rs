//! Routes `GET` and `POST /robots/{id}/description`: the configuration that a robot's own description
//! implies, and taking it over.

use axum::Json;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use fleetcal_domain::robot::{DescribedConfig, RobotConfig, RobotView};
use fleetcal_proto::RobotId;
use fleetcal_proto::description::DescriptionDocument;
use serde::{Deserialize, Serialize};

use super::registration::store;
use crate::ApiState;
use crate::access::Caller;
use crate::extract::{Parameters, RobotPath, check_length};
use crate::problem::Problem;

/// Longest name of a frame in a request, characters.
const FRAME_CHARS_MAX: usize = 200;

/// Configuration that a robot's description implies.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct DescribedRobot {
    /// Its values with their sources. A value is `used` if the robot's configuration has it. Without a
    /// description `origins` is empty.
    description: DescriptionDocument,
    /// Configuration after it is taken over; null if the robot has no configuration and the description
    /// gives no model or no wheelbase.
    #[schema(nullable, required = true)]
    proposed: Option<RobotConfig>,
}

/// Parameters of `/robots/{id}/description`.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct DescriptionParameters {
    /// Frame of the scans, where the robot has several scanners.
    scan_frame: Option<String>,
}

/// Returns the configuration that the robot's own description implies.
///
/// The description is the `robot_description` (URDF) and the `tf_static` that the robot publishes under
/// its keys or in its ROS 2 namespace. `description.remarks` names what contradicts the configuration,
/// and what was refused.
#[utoipa::path(
    get,
    path = "/robots/{id}/description",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot."), DescriptionParameters),
    responses(
        (status = OK, description = "The implied configuration", body = DescribedRobot),
        (status = NOT_FOUND, description = "The robot is unknown"),
    )
)]
pub(super) async fn get_description(
    State(api): State<ApiState>,
    RobotPath(id): RobotPath,
    Parameters(parameters): Parameters<DescriptionParameters>,
) -> Result<Json<DescribedRobot>, Problem> {
    let configured = view(&api, &id)?.config;
    described(&api, &id, &parameters, configured).map(Json)
}

/// Takes over the configuration that the robot's own description implies.
///
/// Described values replace those of the configuration; the rest of it stays. `If-Match` and
/// `If-None-Match` are those of `PUT /robots/{id}`.
#[utoipa::path(
    post,
    path = "/robots/{id}/description",
    tag = "robots",
    params(
        ("id" = RobotId, Path, description = "The robot."),
        DescriptionParameters,
        ("If-Match" = Option<String>, Header, description = "The ETag of GET /robots/{id}."),
        ("If-None-Match" = Option<String>, Header, description = "`*` for a new robot."),
    ),
    responses(
        (status = OK, description = "The changed robot", body = super::document::RobotDocument,
            headers(("ETag" = String, description = "Version of the configuration."))),
        (status = CREATED, description = "The registered robot",
            body = super::document::RobotDocument,
            headers(("ETag" = String, description = "Version of the configuration."))),
        (status = CONFLICT, description = "The limit of robots is reached"),
        (status = NOT_FOUND, description = "The robot is unknown"),
        (status = PRECONDITION_FAILED,
            description = "The configuration has changed since `If-Match`, or exists despite `If-None-Match`"),
        (status = PRECONDITION_REQUIRED,
            description = "Neither `If-Match` nor `If-None-Match` is given"),
        (status = BAD_REQUEST, description = "The robot has published no description, or it gives too little"),
    )
)]
pub(super) async fn take_description(
    State(api): State<ApiState>,
    RobotPath(id): RobotPath,
    Parameters(parameters): Parameters<DescriptionParameters>,
    caller: Caller,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    view(&api, &id)?;
    // As it is stored: what another instance has just changed may not have arrived here yet, and a
    // precondition is about the stored version.
    let stored = api.store.load_robot(&id).await?;
    let described = described(
        &api,
        &id,
        &parameters,
        stored.and_then(|robot| robot.config),
    )?;
    let DescriptionDocument {
        values, missing, ..
    } = described.description;
    let config = described.proposed.filter(|_| !values.is_empty());
    let config = config.ok_or_else(|| {
        let reasons = match values.as_slice() {
            [] => "nothing".to_owned(),
            _ => missing.join("; "),
        };
        Problem::refused("description", &reasons, "one with model and wheelbase_m")
    })?;
    store(api, id, config, &headers, caller.actor).await
}

fn view(api: &ApiState, id: &RobotId) -> Result<RobotView, Problem> {
    let unknown = || Problem::robot_unknown(id.as_str());
    api.fleet.robot(id).ok_or_else(unknown)
}

fn described(
    api: &ApiState,
    id: &RobotId,
    parameters: &DescriptionParameters,
    configured: Option<RobotConfig>,
) -> Result<DescribedRobot, Problem> {
    if let Some(frame) = &parameters.scan_frame {
        check_length("scan_frame", frame, FRAME_CHARS_MAX)?;
    }
    let read = api.fleet.description(id).unwrap_or_default();
    let proposal = read.description.propose(parameters.scan_frame.as_deref());
    let by_itself = DescribedConfig::of(&proposal);
    let mut description = by_itself.document(read.origins, configured.as_ref());
    description.remarks.extend(read.remarks);
    Ok(DescribedRobot {
        description,
        proposed: by_itself.over(configured),
    })
}
