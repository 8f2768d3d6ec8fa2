//! Routes of `/policy`: the rules of proposals, approvals and verification.

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use fleetcal_documents::{PolicyBody, PolicyDocument};
use fleetcal_domain::approval::PolicyRefused;
use fleetcal_domain::limits;
use fleetcal_store::StoredPolicy;

use crate::ApiState;
use crate::access::Caller;
use crate::etag::{expected_version, versioned_json};
use crate::extract::{Body, NoParameters, Parameters, check_length};
use crate::problem::Problem;
use crate::time;

/// Returns the policy in force: the one set here, or else `[approval]` in `fleetcal.toml`, defaults
/// included.
///
/// The `ETag` is its version.
#[utoipa::path(get, path = "/policy", tag = "approval",
    responses(
        (status = OK, description = "The policy in force", body = PolicyDocument,
            headers(("ETag" = String, description = "Version of the policy."))),
    ))]
pub(super) async fn get_policy(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Response {
    answer(&api, api.lifecycle.stored_policy())
}

/// Sets the policy.
///
/// It applies to proposals, approvals and verifications from now on.
#[utoipa::path(
    put,
    path = "/policy",
    tag = "approval",
    params(("If-Match" = String, Header, description = "The ETag of GET.")),
    request_body = PolicyBody,
    responses(
        (status = OK, description = "The policy now in force", body = PolicyDocument,
            headers(("ETag" = String, description = "Version of the policy."))),
    )
)]
pub(super) async fn put_policy(
    State(api): State<ApiState>,
    caller: Caller,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    headers: HeaderMap,
    Body { value, .. }: Body<PolicyBody>,
) -> Result<Response, Problem> {
    let version = expected_version(&headers)?;
    check_length("reason", &value.reason, limits::NOTE_CHARS_MAX)?;
    if let Some(policy) = &value.policy {
        policy.check().map_err(|error| refused(&error))?;
    }
    let stored = api
        .lifecycle
        .change_policy(value.policy, version, caller.actor, value.reason)
        .await?;
    Ok(answer(&api, stored))
}

/// Problem of a refused policy, which is the field `policy` of the body.
fn refused(PolicyRefused { key, got, expected }: &PolicyRefused) -> Problem {
    let field = format!("policy.{key}");
    let detail = format!("{field}: got {got}, expected {expected}");
    Problem::new(StatusCode::BAD_REQUEST, "value_refused", detail).of_field(&field)
}

fn answer(api: &ApiState, stored: StoredPolicy) -> Response {
    let is_set = stored.policy.is_some();
    let document = PolicyDocument {
        policy: stored.policy.unwrap_or_else(|| *api.lifecycle.policy()),
        set_by: stored.by.filter(|_| is_set),
        set_at: stored.at_ns.filter(|_| is_set).map(time::of),
        set_reason: stored.reason.filter(|_| is_set),
    };
    versioned_json(StatusCode::OK, stored.version, document)
}
