//! `/policy`: when something is proposed, who has to agree, and when it counts as proven.

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use fleetcal_domain::approval::{Policy, PolicyRefused};
use fleetcal_domain::limits;
use fleetcal_store::StoredPolicy;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::ApiState;
use crate::access::Caller;
use crate::etag::{expected_version, versioned_json};
use crate::extract::{Body, NoParameters, Parameters, check_length};
use crate::problem::Problem;
use crate::time;

/// The policy in force, and who set it.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = PolicyInForce)]
pub(super) struct PolicyDocument {
    /// What counts.
    #[serde(flatten)]
    policy: Policy,
    /// Who set it; absent while `[approval]` in `fleetcal.toml` counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    set_by: Option<String>,
    /// When.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>, format = DateTime)]
    set_at: Option<Timestamp>,
    /// Why.
    #[serde(skip_serializing_if = "Option::is_none")]
    set_reason: Option<String>,
}

/// Gives the policy in force: what was set here, else what `[approval]` in `fleetcal.toml` says,
/// defaults included. The `ETag` is its version.
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

/// A policy and why it is set.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(as = PolicyRequest)]
#[serde(deny_unknown_fields)]
pub(super) struct PolicyBody {
    /// The whole policy: a key left out takes its default. Null goes back to what `[approval]` in
    /// `fleetcal.toml` says.
    #[serde(deserialize_with = "Option::deserialize")]
    #[schema(required = true)]
    policy: Option<Policy>,
    /// Why, 1 to 1000 characters.
    #[schema(min_length = 1, max_length = 1000)]
    reason: String,
}

/// Sets the policy. What is proposed, approved and verified from now on goes by it.
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

/// The answer to a policy that was refused, which is the field `policy` of the body.
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
