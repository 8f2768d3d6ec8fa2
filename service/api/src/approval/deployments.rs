//! Routes of `/robots/{id}/deployments`, `/shadow` and `/rollback`: the deployments of a robot's
//! calibration.

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use fleetcal_domain::approval::{Command, Deployment};
use fleetcal_domain::limits;
use fleetcal_proto::RobotId;
use futures::FutureExt;
use serde::{Deserialize, Serialize};

use super::proposals::ReasonBody;
use crate::ApiState;
use crate::access::Caller;
use crate::etag::{expected_version, versioned_json};
use crate::extract::{Body, NoParameters, Parameters, RobotPath, check_length, number_of};
use crate::listing::{self, Rows, number};
use crate::page::page_limit;
use crate::problem::Problem;
use fleetcal_documents::{DeploymentDocument, ShadowDocument};

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct DeploymentParameters {
    /// Deployments of a page, 1 to 1000.
    #[param(value_type = Option<u32>)]
    limit: Option<String>,
    /// Value of `next` of the previous page.
    cursor: Option<String>,
}

/// A page of deployments, newest first.
#[derive(Serialize, utoipa::ToSchema)]
pub(super) struct DeploymentPage {
    items: Vec<DeploymentDocument>,
    /// Value of `cursor` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
}

/// Lists a robot's deployments, newest first.
#[utoipa::path(
    get,
    path = "/robots/{id}/deployments",
    tag = "approval",
    params(("id" = RobotId, Path, description = "The robot."), DeploymentParameters),
    responses(
        (status = OK, description = "A page of deployments", body = DeploymentPage),
        (status = NOT_FOUND, description = "The robot is unknown"),
    )
)]
pub(super) async fn list_deployments(
    State(api): State<ApiState>,
    RobotPath(id): RobotPath,
    Parameters(query): Parameters<DeploymentParameters>,
) -> Result<Response, Problem> {
    let limit = page_limit(query.limit.as_deref())?;
    let before = query.cursor.as_deref().map(number_of).transpose()?;
    known(&api, &id)?;
    let store = api.store.clone();
    let read = move |before, limit| {
        let (store, id) = (store.clone(), id.clone());
        let documents = async move {
            let found = store.deployments(&id, before, limit).await?;
            let numbered = |one: Deployment| (number(one.id.0), DeploymentDocument::of(one));
            Ok(found.into_iter().map(numbered).collect())
        };
        documents.boxed()
    };
    listing::page(Rows::new(before, limit, read)).await
}

/// Returns a robot's desired and reported calibration.
///
/// The `ETag` is the version.
#[utoipa::path(
    get,
    path = "/robots/{id}/shadow",
    tag = "approval",
    params(("id" = RobotId, Path, description = "The robot.")),
    responses(
        (status = OK, description = "The shadow", body = ShadowDocument,
            headers(("ETag" = String, description = "Version of the shadow."))),
        (status = NOT_FOUND, description = "The robot is unknown"),
    )
)]
pub(super) async fn get_shadow(
    State(api): State<ApiState>,
    RobotPath(id): RobotPath,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Response, Problem> {
    known(&api, &id)?;
    Ok(shadow_of(&api, &id))
}

/// Rolls a robot back to its former calibration: from the deployment under way, or else to the last
/// verified one before the present one.
///
/// It needs no second person, and is recorded in the audit.
#[utoipa::path(
    post,
    path = "/robots/{id}/rollback",
    tag = "approval",
    params(
        ("id" = RobotId, Path, description = "The robot."),
        ("If-Match" = String, Header, description = "The ETag of GET /robots/{id}/shadow."),
    ),
    request_body = ReasonBody,
    responses(
        (status = OK, description = "The shadow after the roll-back began", body = ShadowDocument,
            headers(("ETag" = String, description = "Version of the shadow."))),
        (status = NOT_FOUND, description = "The robot is unknown"),
        (status = CONFLICT,
            description = "There is nothing to roll back to, or the deployment does not permit it"),
    )
)]
pub(super) async fn roll_back(
    State(api): State<ApiState>,
    caller: Caller,
    RobotPath(id): RobotPath,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    headers: HeaderMap,
    Body { value, .. }: Body<ReasonBody>,
) -> Result<Response, Problem> {
    known(&api, &id)?;
    let version = Some(expected_version(&headers)?);
    check_length("reason", &value.reason, limits::NOTE_CHARS_MAX)?;
    let reason = value.reason;
    let command = Command::RollBack { version, reason };
    api.lifecycle
        .decide(&id, command, caller.actor, None)
        .await?;
    Ok(shadow_of(&api, &id))
}

/// Returns the shadow of a robot.
pub(crate) fn shadow_of(api: &ApiState, id: &RobotId) -> Response {
    let ledger = api.lifecycle.ledger(id);
    let document = ShadowDocument::of(&ledger);
    versioned_json(StatusCode::OK, ledger.shadow.version, document)
}

pub(super) fn known(api: &ApiState, id: &RobotId) -> Result<(), Problem> {
    match api.fleet.robot(id) {
        Some(_) => Ok(()),
        None => Err(Problem::robot_unknown(id.as_str())),
    }
}
