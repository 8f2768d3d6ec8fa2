//! Routes of `/deployments/freeze`: the deployment freeze.

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use fleetcal_documents::{FreezeBody, FreezeDocument};
use fleetcal_domain::limits;
use fleetcal_store::DeploymentFreeze;

use crate::ApiState;
use crate::access::Caller;
use crate::etag::{expected_version, versioned_json};
use crate::extract::{Body, NoParameters, Parameters, check_length};
use crate::problem::Problem;
use crate::time;

/// Returns the deployment freeze.
///
/// The `ETag` is its version.
#[utoipa::path(get, path = "/deployments/freeze", tag = "approval",
    responses(
        (status = OK, description = "The deployment freeze", body = FreezeDocument,
            headers(("ETag" = String, description = "Version of the freeze."))),
    ))]
pub(super) async fn get_freeze(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Response {
    answer(api.lifecycle.deployment_freeze())
}

/// Freezes the deployments that are not applied yet, or resumes them.
///
/// Roll-backs continue.
#[utoipa::path(
    put,
    path = "/deployments/freeze",
    tag = "approval",
    params(("If-Match" = String, Header, description = "The ETag of GET.")),
    request_body = FreezeBody,
    responses(
        (status = OK, description = "The changed deployment freeze", body = FreezeDocument,
            headers(("ETag" = String, description = "Version of the freeze."))),
    )
)]
pub(super) async fn put_freeze(
    State(api): State<ApiState>,
    caller: Caller,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    headers: HeaderMap,
    Body { value, .. }: Body<FreezeBody>,
) -> Result<Response, Problem> {
    let version = expected_version(&headers)?;
    check_length("reason", &value.reason, limits::NOTE_CHARS_MAX)?;
    let freeze = api
        .lifecycle
        .freeze(value.frozen, version, caller.actor, value.reason)
        .await?;
    Ok(answer(freeze))
}

fn answer(freeze: DeploymentFreeze) -> Response {
    let document = FreezeDocument {
        version: freeze.version,
        frozen: freeze.frozen,
        by: freeze.by,
        at: freeze.at_ns.map(time::of),
        reason: freeze.reason,
    };
    versioned_json(StatusCode::OK, freeze.version, document)
}
