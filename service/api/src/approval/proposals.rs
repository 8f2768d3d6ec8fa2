//! Routes of `/proposals`: open and closed proposals, and people's decisions.

use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use fleetcal_domain::approval::{
    Command, DeploymentState, Evidence, Origin, Proposal, ProposalState, Revision, expected_gain,
    outdated, values_and_sigmas,
};
use fleetcal_domain::limits;
use fleetcal_model::{Generation, ProposalId, Version};
use fleetcal_operations::lifecycle::Decided;
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationValues;
use fleetcal_store::{IdempotencyKey, ProposalFilter, StoreError};
use futures::FutureExt;
use serde::{Deserialize, Serialize};

use crate::ApiState;
use crate::access::Caller;
use crate::etag::{expected_version, versioned_json};
use crate::extract::{Body, NoParameters, Parameters, check_length, idempotency_key, number_of};
use crate::listing::{self, Numbered, Rows, number};
use crate::page::page_limit;
use crate::problem::Problem;
use fleetcal_documents::{Beside, ProposalDocument};

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct ProposalParameters {
    /// State of the proposals.
    #[param(value_type = Option<ProposalState>)]
    state: Option<String>,
    /// Robot of the proposals.
    #[param(value_type = Option<RobotId>)]
    robot: Option<String>,
    /// Proposals of a page, 1 to 1000.
    #[param(value_type = Option<u32>)]
    limit: Option<String>,
    /// Value of `next` of the previous page.
    cursor: Option<String>,
}

/// A page of proposals, newest first.
#[derive(Serialize, utoipa::ToSchema)]
pub(super) struct ProposalPage {
    items: Vec<ProposalDocument>,
    /// Value of `cursor` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
}

/// Lists proposals, newest first.
#[utoipa::path(
    get,
    path = "/proposals",
    tag = "approval",
    params(ProposalParameters),
    responses(
        (status = OK, description = "A page of proposals", body = ProposalPage),
    )
)]
pub(super) async fn list_proposals(
    State(api): State<ApiState>,
    Parameters(query): Parameters<ProposalParameters>,
) -> Result<Response, Problem> {
    let limit = page_limit(query.limit.as_deref())?;
    let filter = ProposalFilter {
        robot: query.robot.as_deref().map(robot_named).transpose()?,
        state: query.state.as_deref().map(state_named).transpose()?,
        before: None,
        limit,
    };
    let before = query.cursor.as_deref().map(number_of).transpose()?;
    let read = move |before, limit| {
        let (api, mut filter) = (api.clone(), filter.clone());
        (filter.before, filter.limit) = (before, limit);
        async move { documents(&api, &filter).await }.boxed()
    };
    listing::page(Rows::new(before, limit, read)).await
}

/// Proposals that match a filter.
async fn documents(
    api: &ApiState,
    filter: &ProposalFilter,
) -> Result<Numbered<ProposalDocument>, StoreError> {
    let found = api.store.proposals(filter).await?;
    let ids: Vec<ProposalId> = found.iter().map(|(proposal, _)| proposal.id).collect();
    let followed = api.store.followed(&ids).await?;
    let documents = found.into_iter().map(|(proposal, revision)| {
        let id = proposal.id;
        let deployment = followed.get(&id).copied();
        (number(id.0), document(api, proposal, revision, deployment))
    });
    Ok(documents.collect())
}

/// Proposal to be made.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(as = NewProposal)]
#[serde(deny_unknown_fields)]
pub(crate) struct NewProposalDocument {
    /// Robot that it is for.
    pub(crate) robot: RobotId,
    /// Values, absolute; those of the robot's latest estimate unless given.
    #[serde(default)]
    pub(crate) values: Option<CalibrationValues>,
    /// Reason for the proposal, at most 1000 characters.
    #[schema(max_length = 1000)]
    pub(crate) reason: String,
}

/// Proposes a calibration: the robot's latest estimate, or values from elsewhere.
///
/// An open proposal of the robot is superseded.
#[utoipa::path(
    post,
    path = "/proposals",
    tag = "approval",
    params(("Idempotency-Key" = String, Header,
        description = "The same for each repetition of a request, at most 128 characters.")),
    request_body = NewProposalDocument,
    responses(
        (status = CREATED, description = "The new proposal", body = ProposalDocument,
            headers(("ETag" = String, description = "Version of the proposal."))),
        (status = NOT_FOUND, description = "The robot is unknown"),
        (status = CONFLICT,
            description = "A deployment is under way, or the estimate is not known well enough to propose"),
    )
)]
pub(super) async fn post_proposal(
    State(api): State<ApiState>,
    caller: Caller,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    headers: HeaderMap,
    Body { value, sha256 }: Body<NewProposalDocument>,
) -> Result<Response, Problem> {
    let key = required_key(&headers, sha256)?;
    let id = propose(&api, &caller, &value, key).await?;
    answer(&api, id, StatusCode::CREATED).await
}

/// Returns the `Idempotency-Key` of a request that proposes.
pub(crate) fn required_key(
    headers: &HeaderMap,
    sha256: [u8; 32],
) -> Result<IdempotencyKey, Problem> {
    idempotency_key(headers, sha256)?.ok_or_else(|| {
        let detail = "send an Idempotency-Key, the same for each repetition of this request";
        let status = StatusCode::PRECONDITION_REQUIRED;
        Problem::new(status, "precondition_required", detail).of_field("Idempotency-Key")
    })
}

/// Proposes a calibration; returns the number of the proposal.
pub(crate) async fn propose(
    api: &ApiState,
    caller: &Caller,
    value: &NewProposalDocument,
    key: IdempotencyKey,
) -> Result<ProposalId, Problem> {
    check_length("reason", &value.reason, limits::NOTE_CHARS_MAX)?;
    let command = proposed(api, value)?;
    let actor = caller.actor.clone();
    let deciding = api
        .lifecycle
        .decide(&value.robot, command, actor, Some(key));
    let id = match deciding.await? {
        Decided::Taken(outcome) => outcome.proposals.last().map(|proposal| proposal.id),
        Decided::Repeated(proposal) => Some(proposal.id),
    };
    Ok(id.unwrap_or_default())
}

fn proposed(api: &ApiState, value: &NewProposalDocument) -> Result<Command, Problem> {
    let id = &value.robot;
    let unknown = || Problem::robot_unknown(id.as_str());
    let view = api.fleet.robot(id);
    let configured = view.filter(|view| view.config.is_some());
    let view = configured.ok_or_else(unknown)?;
    let (origin, (values, sigmas), evidence) = if let Some(values) = value.values {
        let unmeasured = CalibrationValues::default();
        (Origin::Person, (values, unmeasured), Evidence::default())
    } else {
        let known = view.estimate.as_deref();
        let known = known.and_then(|one| Some((values_and_sigmas(one)?, Evidence::of(one))));
        let (found, evidence) = known.ok_or_else(|| {
            let detail = format!(
                "the calibration of {id} is not known yet; its estimate lists the motion that it needs"
            );
            Problem::new(StatusCode::CONFLICT, "not_known_yet", detail)
        })?;
        (Origin::Estimator, found, evidence)
    };
    Ok(Command::Propose {
        origin,
        values,
        sigmas,
        evidence,
        reason: Some(value.reason.clone()).filter(|reason| !reason.trim().is_empty()),
    })
}

/// Returns one proposal.
///
/// The `ETag` is its version.
#[utoipa::path(
    get,
    path = "/proposals/{id}",
    tag = "approval",
    params(("id" = u64, Path, description = "The proposal.")),
    responses(
        (status = OK, description = "The proposal", body = ProposalDocument,
            headers(("ETag" = String, description = "Version of the proposal."))),
        (status = NOT_FOUND, description = "The proposal is unknown"),
    )
)]
pub(super) async fn get_proposal(
    State(api): State<ApiState>,
    Path(id): Path<String>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Response, Problem> {
    answer(&api, proposal_number(&id)?, StatusCode::OK).await
}

/// Approval of a proposal.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(as = ApprovalRequest)]
#[serde(deny_unknown_fields)]
pub(super) struct ApprovalBody {
    /// Hash `revision.sha256` of the proposal that the person read.
    sha256: String,
    /// Reason for the approval, at most 1000 characters.
    #[serde(default)]
    #[schema(max_length = 1000)]
    reason: Option<String>,
}

/// Rejection, withdrawal or roll-back with its reason.
#[derive(Debug, Clone, Deserialize, utoipa::ToSchema)]
#[schema(as = ReasonGiven)]
#[serde(deny_unknown_fields)]
pub(crate) struct ReasonBody {
    /// Reason, 1 to 1000 characters.
    #[schema(min_length = 1, max_length = 1000)]
    pub(crate) reason: String,
}

/// Approves a proposal.
///
/// The last required approval starts the deployment. Nobody can approve their own proposal.
#[utoipa::path(
    post,
    path = "/proposals/{id}/approve",
    tag = "approval",
    params(
        ("id" = u64, Path, description = "The proposal."),
        ("If-Match" = String, Header, description = "The ETag of GET."),
    ),
    request_body = ApprovalBody,
    responses(
        (status = OK, description = "The approved proposal", body = ProposalDocument,
            headers(("ETag" = String, description = "Version of the proposal."))),
        (status = FORBIDDEN,
            description = "The role does not permit approval, or the caller has proposed or approved it already"),
        (status = NOT_FOUND, description = "The proposal is unknown"),
        (status = CONFLICT,
            description = "The proposal is closed, or the present estimate contradicts it"),
        (status = PRECONDITION_FAILED,
            description = "The proposal has changed, or `sha256` is not that of its revision"),
    )
)]
pub(super) async fn approve_proposal(
    State(api): State<ApiState>,
    caller: Caller,
    Path(id): Path<String>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    headers: HeaderMap,
    Body { value, .. }: Body<ApprovalBody>,
) -> Result<Response, Problem> {
    let ApprovalBody { sha256, reason } = value;
    let given = reason.clone().unwrap_or_default();
    let command = |proposal, version| Command::Approve {
        proposal,
        version,
        sha256,
        reason,
    };
    decide(&api, caller, (&id, &headers), &given, command).await
}

/// Rejects a proposal.
#[utoipa::path(
    post,
    path = "/proposals/{id}/reject",
    tag = "approval",
    params(
        ("id" = u64, Path, description = "The proposal."),
        ("If-Match" = String, Header, description = "The ETag of GET."),
    ),
    request_body = ReasonBody,
    responses(
        (status = OK, description = "The rejected proposal", body = ProposalDocument,
            headers(("ETag" = String, description = "Version of the proposal."))),
        (status = NOT_FOUND, description = "The proposal is unknown"),
        (status = CONFLICT, description = "The proposal is closed"),
    )
)]
pub(super) async fn reject_proposal(
    State(api): State<ApiState>,
    caller: Caller,
    Path(id): Path<String>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    headers: HeaderMap,
    Body { value, .. }: Body<ReasonBody>,
) -> Result<Response, Problem> {
    let reason = value.reason.clone();
    let command = |proposal, version| Command::Reject {
        proposal,
        version,
        reason,
    };
    decide(&api, caller, (&id, &headers), &value.reason, command).await
}

/// Withdraws a proposal.
#[utoipa::path(
    post,
    path = "/proposals/{id}/withdraw",
    tag = "approval",
    params(
        ("id" = u64, Path, description = "The proposal."),
        ("If-Match" = String, Header, description = "The ETag of GET."),
    ),
    request_body = ReasonBody,
    responses(
        (status = OK, description = "The withdrawn proposal", body = ProposalDocument,
            headers(("ETag" = String, description = "Version of the proposal."))),
        (status = NOT_FOUND, description = "The proposal is unknown"),
        (status = CONFLICT, description = "The proposal is closed"),
    )
)]
pub(super) async fn withdraw_proposal(
    State(api): State<ApiState>,
    caller: Caller,
    Path(id): Path<String>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    headers: HeaderMap,
    Body { value, .. }: Body<ReasonBody>,
) -> Result<Response, Problem> {
    let reason = Some(value.reason.clone()).filter(|reason| !reason.trim().is_empty());
    let command = |proposal, version| Command::Withdraw {
        proposal,
        version,
        reason,
    };
    decide(&api, caller, (&id, &headers), &value.reason, command).await
}

/// Decides on the proposal of number `id`, in the version of `headers`, and returns the proposal
/// afterwards. `command` makes the command from the two; `reason` is the caller's.
async fn decide(
    api: &ApiState,
    caller: Caller,
    (id, headers): (&str, &HeaderMap),
    reason: &str,
    command: impl FnOnce(ProposalId, Option<Version>) -> Command,
) -> Result<Response, Problem> {
    let version = Some(expected_version(headers)?);
    let id = proposal_number(id)?;
    close(api, &caller, id, reason, command(id, version)).await?;
    answer(api, id, StatusCode::OK).await
}

/// Decides on a proposal by `command`, which has the caller's `reason`.
pub(crate) async fn close(
    api: &ApiState,
    caller: &Caller,
    id: ProposalId,
    reason: &str,
    command: Command,
) -> Result<(), Problem> {
    check_length("reason", reason, limits::NOTE_CHARS_MAX)?;
    let robot = robot_of(api, id).await?;
    let actor = caller.actor.clone();
    api.lifecycle.decide(&robot, command, actor, None).await?;
    Ok(())
}

/// Robot of a proposal.
pub(crate) async fn robot_of(api: &ApiState, proposal: ProposalId) -> Result<RobotId, Problem> {
    let found = api.store.proposal(proposal).await?;
    let (proposal, _) = found.ok_or_else(|| unknown(proposal))?;
    Ok(proposal.robot)
}

async fn answer(api: &ApiState, id: ProposalId, status: StatusCode) -> Result<Response, Problem> {
    let found = api.store.proposal(id).await?;
    let (proposal, revision) = found.ok_or_else(|| unknown(id))?;
    let version = proposal.version;
    let deployment = api.store.followed(&[id]).await?.remove(&id);
    let document = document(api, proposal, revision, deployment);
    Ok(versioned_json(status, version, document))
}

/// Document of a proposal as of now.
fn document(
    api: &ApiState,
    proposal: Proposal,
    revision: Revision,
    deployment: Option<DeploymentState>,
) -> ProposalDocument {
    let robot = &proposal.robot;
    let outdated = match proposal.state {
        ProposalState::Proposed => outdated(&revision, &api.lifecycle.present(robot)),
        _ => None,
    };
    let gain = proposal.base.as_ref().and_then(|base| {
        let errors = api.fleet.cross_tracks(robot);
        let errors = errors.get(&proposal.base_generation.unwrap_or(Generation::FACTORY))?;
        expected_gain(
            base,
            &revision,
            errors,
            &api.lifecycle.policy().verify_within,
        )
    });
    ProposalDocument::of(
        proposal,
        revision,
        Beside {
            outdated,
            gain,
            deployment,
        },
    )
}

fn unknown(id: ProposalId) -> Problem {
    let detail = format!("no proposal {id} is known");
    Problem::new(StatusCode::NOT_FOUND, "proposal_unknown", detail)
}

fn proposal_number(id: &str) -> Result<ProposalId, Problem> {
    id.parse()
        .map_err(|_| Problem::refused("id", id, "the number of a proposal"))
}

pub(crate) fn robot_named(id: &str) -> Result<RobotId, Problem> {
    RobotId::parse(id).map_err(|error| {
        let status = StatusCode::BAD_REQUEST;
        Problem::new(status, "value_refused", error.to_string()).of_field("robot")
    })
}

fn state_named(name: &str) -> Result<ProposalState, Problem> {
    ProposalState::parse(name).ok_or_else(|| {
        let accepted: Vec<&str> = ProposalState::ALL.iter().map(|one| one.as_str()).collect();
        let accepted = accepted.join(", ");
        Problem::refused("state", name, &format!("one of {accepted}"))
    })
}
