//! `/site/hold`: the site-wide stop.

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use fleetcal_domain::limits;
use fleetcal_store::SiteHold;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::ApiState;
use crate::access::Caller;
use crate::etag::{expected_version, versioned_json};
use crate::extract::{Body, NoParameters, Parameters, check_length};
use crate::problem::Problem;
use crate::time;

/// The site-wide stop. Its `ETag` is `version`.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = SiteHold)]
pub(super) struct HoldDocument {
    /// Goes up with every change of it.
    version: u64,
    /// While it is held, no robot is offered what it does not use yet.
    held: bool,
    /// Who changed it last.
    by: Option<String>,
    #[schema(value_type = Option<String>, format = DateTime)]
    at: Option<Timestamp>,
    /// Why.
    reason: Option<String>,
}

/// Gives the site-wide stop. The `ETag` is its version.
#[utoipa::path(get, path = "/site/hold", tag = "approval",
    responses(
        (status = OK, description = "The site-wide hold", body = HoldDocument,
            headers(("ETag" = String, description = "Version of the stop."))),
    ))]
pub(super) async fn get_hold(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Response {
    answer(api.clerk.site_hold())
}

/// Whether to hold.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(as = HoldRequest)]
#[serde(deny_unknown_fields)]
pub(super) struct HoldBody {
    /// `true` to hold every deployment that is not applied yet, `false` to let them go on.
    held: bool,
    /// Why, 1 to 1000 characters.
    #[schema(min_length = 1, max_length = 1000)]
    reason: String,
}

/// Holds every deployment that is not applied yet, or lets them go on. Roll-backs go on.
#[utoipa::path(
    put,
    path = "/site/hold",
    tag = "approval",
    params(("If-Match" = String, Header, description = "The ETag of GET.")),
    request_body = HoldBody,
    responses(
        (status = OK, description = "The changed site-wide hold", body = HoldDocument,
            headers(("ETag" = String, description = "Version of the stop."))),
    )
)]
pub(super) async fn put_hold(
    State(api): State<ApiState>,
    caller: Caller,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    headers: HeaderMap,
    Body { value, .. }: Body<HoldBody>,
) -> Result<Response, Problem> {
    let version = expected_version(&headers)?;
    check_length("reason", &value.reason, limits::NOTE_CHARS_MAX)?;
    let hold = api
        .clerk
        .hold(value.held, version, caller.actor, value.reason)
        .await?;
    Ok(answer(hold))
}

fn answer(hold: SiteHold) -> Response {
    let document = HoldDocument {
        version: hold.version,
        held: hold.held,
        by: hold.by,
        at: hold.at_ns.map(time::of_ns),
        reason: hold.reason,
    };
    versioned_json(StatusCode::OK, hold.version, document)
}
