//! Routes of one roll-out.

use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::Response;
use fleetcal_documents::{ResumeRequest, RolloutDocument, against};
use fleetcal_domain::limits;
use fleetcal_model::RolloutId;
use fleetcal_operations::lifecycle::{ChangeRollout, RolloutChange};
use fleetcal_rollout::{Member, Rollout, RolloutRefused};
use fleetcal_store::StoreError;

use crate::ApiState;
use crate::access::Caller;
use crate::approval::ReasonBody;
use crate::etag::{expected_version, versioned_json};
use crate::extract::{Body, NoParameters, Parameters, check_length};
use crate::problem::Problem;

/// Returns a roll-out with the stage of each robot.
///
/// The `ETag` is its version.
#[utoipa::path(get, path = "/rollouts/{id}", tag = "rollouts",
    params(("id" = u64, Path, description = "The roll-out.")),
    responses(
        (status = OK, description = "The roll-out", body = RolloutDocument,
            headers(("ETag" = String, description = "Version of the roll-out."))),
        (status = NOT_FOUND, description = "The roll-out is unknown"),
    ))]
pub(super) async fn get_rollout(
    State(api): State<ApiState>,
    Path(id): Path<String>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Response, Problem> {
    let id = number(&id)?;
    let found = api.store.rollout(id).await?;
    let rollout = found.ok_or(StoreError::from(RolloutRefused::Unknown(id)))?;
    shown(&api, StatusCode::OK, rollout).await
}

/// Pauses a roll-out: it releases no further robot. What is under way continues.
#[utoipa::path(post, path = "/rollouts/{id}/pause", tag = "rollouts",
    params(("id" = u64, Path, description = "The roll-out."),
        ("If-Match" = Option<String>, Header, description = "The ETag of GET; any version without.")),
    request_body = ReasonBody,
    responses(
        (status = OK, description = "The paused roll-out", body = RolloutDocument),
        (status = NOT_FOUND, description = "The roll-out is unknown"),
        (status = CONFLICT, description = "The roll-out does not run"),
    ))]
pub(super) async fn pause_rollout(
    State(api): State<ApiState>,
    caller: Caller,
    Path(id): Path<String>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    headers: HeaderMap,
    Body { value, .. }: Body<ReasonBody>,
) -> Result<Response, Problem> {
    let change = RolloutChange::Pause;
    changed(&api, caller, (&id, &headers), (change, value.reason)).await
}

/// Resumes a paused or halted roll-out.
///
/// After a halt, the lost robots that `lost` has are accepted: only further ones halt it again. It
/// is refused if a wave has lost more by now.
#[utoipa::path(post, path = "/rollouts/{id}/resume", tag = "rollouts",
    params(("id" = u64, Path, description = "The roll-out."),
        ("If-Match" = Option<String>, Header, description = "The ETag of GET; any version without.")),
    request_body = ResumeRequest,
    responses(
        (status = OK, description = "The running roll-out", body = RolloutDocument),
        (status = NOT_FOUND, description = "The roll-out is unknown"),
        (status = CONFLICT, description = "It is neither paused nor halted, or another one has its robots"),
    ))]
pub(super) async fn resume_rollout(
    State(api): State<ApiState>,
    caller: Caller,
    Path(id): Path<String>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    headers: HeaderMap,
    Body { value, .. }: Body<ResumeRequest>,
) -> Result<Response, Problem> {
    let change = RolloutChange::Resume(value.lost);
    changed(&api, caller, (&id, &headers), (change, value.reason)).await
}

/// Halts a roll-out, since something is wrong. What is under way continues.
#[utoipa::path(post, path = "/rollouts/{id}/halt", tag = "rollouts",
    params(("id" = u64, Path, description = "The roll-out."),
        ("If-Match" = Option<String>, Header, description = "The ETag of GET; any version without.")),
    request_body = ReasonBody,
    responses(
        (status = OK, description = "The halted roll-out", body = RolloutDocument),
        (status = NOT_FOUND, description = "The roll-out is unknown"),
        (status = CONFLICT, description = "The roll-out is halted or finished already"),
    ))]
pub(super) async fn halt_rollout(
    State(api): State<ApiState>,
    caller: Caller,
    Path(id): Path<String>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    headers: HeaderMap,
    Body { value, .. }: Body<ReasonBody>,
) -> Result<Response, Problem> {
    let change = RolloutChange::Halt;
    changed(&api, caller, (&id, &headers), (change, value.reason)).await
}

async fn changed(
    api: &ApiState,
    caller: Caller,
    (id, headers): (&str, &HeaderMap),
    (change, reason): (RolloutChange, String),
) -> Result<Response, Problem> {
    check_length("reason", &reason, limits::NOTE_CHARS_MAX)?;
    let is_bound = headers.contains_key(header::IF_MATCH);
    let version = is_bound.then(|| expected_version(headers)).transpose()?;
    let change = ChangeRollout {
        id: number(id)?,
        change,
        version,
        reason,
        actor: caller.actor,
        now: api.clock.now(),
    };
    let rollout = api.lifecycle.change_rollout(change).await?;
    shown(api, StatusCode::OK, rollout).await
}

/// Answers with a roll-out and its robots.
pub(super) async fn shown(
    api: &ApiState,
    status: StatusCode,
    rollout: Rollout,
) -> Result<Response, Problem> {
    let robots = api.store.rollout_robots(rollout.id).await?;
    let version = rollout.version;
    let approver = rollout.approver.name.clone();
    let against = |member: &Member| {
        let (ledger, present) = (
            api.lifecycle.ledger(&member.robot),
            api.lifecycle.present(&member.robot),
        );
        against(&ledger, &present, &approver)
    };
    let document = RolloutDocument::shown(rollout, &robots, &against);
    Ok(versioned_json(status, version, document))
}

fn number(id: &str) -> Result<RolloutId, Problem> {
    let refused = |_| Problem::refused("id", id, "the number of a roll-out");
    id.parse().map_err(refused)
}
