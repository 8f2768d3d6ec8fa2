//! Route `POST /proposals/approve`: several approvals in one request, each decided on its own.

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use fleetcal_domain::approval::{Command, ProposalState};
use fleetcal_domain::limits;
use fleetcal_model::{ProposalId, Version};
use fleetcal_operations::lifecycle::Decided;
use serde::{Deserialize, Serialize};

use super::proposals::robot_of;
use crate::ApiState;
use crate::access::{Caller, count_writes};
use crate::each::each;
use crate::extract::{Body, NoParameters, Parameters, check_length};
use crate::problem::Problem;

/// Approvals of several proposals.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(as = SeveralApprovals)]
#[serde(deny_unknown_fields)]
pub(super) struct SeveralBody {
    /// List of 1 to 500 approvals.
    proposals: Vec<OneOfSeveral>,
    /// Reason for the approvals, at most 1000 characters.
    #[serde(default)]
    #[schema(max_length = 1000)]
    reason: Option<String>,
}

/// Approval of one of several proposals.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct OneOfSeveral {
    /// Proposal's number.
    id: ProposalId,
    /// Version that the person read.
    version: Version,
    /// Hash `revision.sha256` that the person read.
    sha256: String,
}

/// Outcomes of several approvals.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct SeveralAnswer {
    /// Outcomes in the order of the request.
    items: Vec<SeveralOutcome>,
}

/// Outcome of one of several approvals.
#[derive(Debug, Serialize, utoipa::ToSchema)]
struct SeveralOutcome {
    /// Proposal's number.
    id: ProposalId,
    /// Present state: `approved`, or still `proposed` while a second person is needed. Absent if
    /// the approval was refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    state: Option<ProposalState>,
    /// Problem of a refused approval.
    #[serde(skip_serializing_if = "Option::is_none")]
    problem: Option<Problem>,
}

/// Approves several proposals, each decided on its own.
///
/// A refused approval does not affect the others. If the database is slow, approvals whose turn
/// does not come in time have the problem `not_tried`, and those under way `outcome_unknown`.
#[utoipa::path(
    post,
    path = "/proposals/approve",
    tag = "approval",
    request_body = SeveralBody,
    responses(
        (status = OK, description = "The outcome of each proposal", body = SeveralAnswer),
    )
)]
pub(super) async fn approve_several(
    State(api): State<ApiState>,
    caller: Caller,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    Body { value, .. }: Body<SeveralBody>,
) -> Result<Json<SeveralAnswer>, Problem> {
    let count = value.proposals.len();
    if count == 0 || count > limits::APPROVED_AT_ONCE_MAX {
        let detail = format!(
            "{count} proposals are named, expected 1 to {}",
            limits::APPROVED_AT_ONCE_MAX
        );
        let status = StatusCode::BAD_REQUEST;
        return Err(Problem::new(status, "value_refused", detail).of_field("proposals"));
    }
    // The request itself counts as one.
    let further = u32::try_from(count - 1).unwrap_or(u32::MAX);
    count_writes(&api, &caller, further)?;
    check_length(
        "reason",
        value.reason.as_deref().unwrap_or(""),
        limits::NOTE_CHARS_MAX,
    )?;
    let ids: Vec<_> = value.proposals.iter().map(|one| one.id).collect();
    let approving = |one| approve(&api, &caller, one, value.reason.clone());
    let decided = each(value.proposals, approving).await;
    let items = ids.into_iter().zip(decided).map(|(id, decided)| {
        let (state, problem) = match decided {
            Ok(state) => (Some(state), None),
            Err(problem) => (None, Some(problem)),
        };
        SeveralOutcome { id, state, problem }
    });
    Ok(Json(SeveralAnswer {
        items: items.collect(),
    }))
}

async fn approve(
    api: &ApiState,
    caller: &Caller,
    one: OneOfSeveral,
    reason: Option<String>,
) -> Result<ProposalState, Problem> {
    let robot = robot_of(api, one.id).await?;
    let command = Command::Approve {
        proposal: one.id,
        version: Some(one.version),
        sha256: one.sha256,
        reason,
    };
    let actor = caller.actor.clone();
    let decided = api.lifecycle.decide(&robot, command, actor, None).await?;
    Ok(match decided {
        Decided::Taken(outcome) => outcome
            .proposals
            .last()
            .map_or(ProposalState::Approved, |proposal| proposal.state),
        Decided::Repeated(proposal) => proposal.state,
    })
}
