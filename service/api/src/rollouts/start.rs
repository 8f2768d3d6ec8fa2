//! Route `POST /rollouts`.

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use fleetcal_documents::{PlanDocument, RolloutDocument, RolloutRequest};
use fleetcal_domain::limits;
use fleetcal_operations::lifecycle::StartRollout;
use serde::Deserialize;

use super::one::shown;
use super::plan::plan;
use crate::ApiState;
use crate::access::Caller;
use crate::extract::{Body, Parameters, check_length};
use crate::problem::Problem;

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct StartParameters {
    /// True to return the plan and start nothing.
    #[serde(default)]
    dry_run: bool,
}

/// Starts a roll-out: the caller approves the pending proposals that a query selects, and their
/// waves release the approvals.
///
/// A dry run returns the plan. A roll-out is started with the hash of the plan that was read, so
/// that nothing is approved which the caller has not seen. A proposal that changes later is left
/// out. Each approval is decided when its wave releases it, by the rules of a single approval and
/// with a row of the audit.
#[utoipa::path(
    post,
    path = "/rollouts",
    tag = "rollouts",
    params(StartParameters),
    request_body = RolloutRequest,
    responses(
        (status = OK, description = "The plan of a dry run", body = PlanDocument),
        (status = CREATED, description = "The running roll-out", body = RolloutDocument,
            headers(("ETag" = String, description = "Version of the roll-out."))),
        (status = CONFLICT, description = "Another one has its robots, or too many go on"),
        (status = PRECONDITION_FAILED, description = "The plan is another by now"),
    )
)]
pub(super) async fn start_rollout(
    State(api): State<ApiState>,
    caller: Caller,
    Parameters(StartParameters { dry_run }): Parameters<StartParameters>,
    Body { value, .. }: Body<RolloutRequest>,
) -> Result<Response, Problem> {
    let reason = value.reason.as_deref().unwrap_or_default();
    check_length("reason", reason, limits::NOTE_CHARS_MAX)?;
    let planned = plan(&api, &caller, value.q.as_deref(), &value.waves).await?;
    let document = planned.document;
    if dry_run {
        return Ok(Json(document).into_response());
    }
    let read = value.plan.as_deref();
    if read != Some(&document.sha256) {
        let (got, found) = (read.unwrap_or("none"), &document.sha256);
        let detail = format!("plan: got {got}, expected that of a dry run now, {found}");
        let status = StatusCode::PRECONDITION_FAILED;
        return Err(Problem::new(status, "plan_changed", detail).of_field("plan"));
    }
    let waves = document.waves.into_iter();
    let waves = waves.map(|wave| (wave.plan, wave.robots.len() as u32));
    let start = StartRollout {
        q: document.q,
        waves: waves.collect(),
        members: planned.members,
        actor: caller.actor,
        reason: value.reason,
        now: api.clock.now(),
    };
    let rollout = api.lifecycle.start_rollout(start).await?;
    shown(&api, StatusCode::CREATED, rollout).await
}
