//! Route `POST /fleet/actions`: one action on many robots, each decided as by its single call.

use std::collections::BTreeSet;

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, Method, StatusCode};
use fleetcal_domain::approval::Command;
use fleetcal_domain::limits;
use fleetcal_model::{AlertId, ProposalId, Version};
use fleetcal_proto::RobotId;
use fleetcal_store::IdempotencyKey;
use serde::{Deserialize, Serialize};

use crate::ApiState;
use crate::access::{self, Caller};
use crate::alerts::{AcknowledgementBody, acknowledge};
use crate::approval::{NewProposalDocument, ReasonBody, close, propose, required_key, robot_of};
use crate::each::each;
use crate::extract::{Body, NoParameters, Parameters};
use crate::problem::Problem;
use crate::robots::{MaintenanceBody, bring_back, maintain, retire};

/// Action on many robots.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(as = FleetAction)]
#[serde(deny_unknown_fields)]
pub(super) struct ActionBody {
    action: Action,
    /// Robots, 1 to 500, each once.
    robots: Vec<Target>,
}

/// Action, with what its single call takes.
#[derive(Debug, Clone, Deserialize, utoipa::ToSchema)]
#[schema(as = ActionOnEach)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum Action {
    /// Begins or ends maintenance.
    Maintenance(MaintenanceBody),
    /// Acknowledges the `alerts` of each robot.
    Acknowledge(AcknowledgementBody),
    /// Proposes the present estimate of each robot.
    Propose(ReasonBody),
    /// Approves the `proposal` of each robot.
    Approve(ApproveBody),
    /// Rejects the `proposal` of each robot.
    Reject(ReasonBody),
    /// Retires each robot.
    Retire(ReasonBody),
    /// Brings each retired robot back.
    BringBack(ReasonBody),
}

/// Approval of each robot's proposal.
#[derive(Debug, Clone, Deserialize, utoipa::ToSchema)]
#[schema(as = ApproveEach)]
#[serde(deny_unknown_fields)]
struct ApproveBody {
    /// Reason for the approvals, at most 1000 characters.
    #[serde(default)]
    #[schema(max_length = 1000)]
    reason: Option<String>,
}

/// Robot to act on, with what the caller read about it.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(as = ActionTarget)]
#[serde(deny_unknown_fields)]
struct Target {
    /// Robot's id.
    id: RobotId,
    /// Proposal to approve or reject.
    #[serde(default)]
    proposal: Option<ReadProposal>,
    /// Alerts to acknowledge, at most 16.
    #[serde(default)]
    #[schema(max_items = 16)]
    alerts: Vec<ReadAlert>,
}

/// Proposal as the caller read it.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
struct ReadProposal {
    /// Proposal's number.
    id: ProposalId,
    /// Version that the person read.
    version: Version,
    /// Hash `revision.sha256` that the person read; an approval needs it.
    #[serde(default)]
    sha256: Option<String>,
}

/// Alert as the caller read it.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
struct ReadAlert {
    /// Alert's number.
    id: AlertId,
    /// Version that the person read.
    version: Version,
}

/// Outcomes of an action on many robots.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = FleetActionAnswer)]
pub(super) struct ActionAnswer {
    /// Number of robots on which the action was done.
    done: usize,
    /// Number of robots with a problem.
    refused: usize,
    /// Outcomes in the order of the request.
    items: Vec<ActionOutcome>,
}

/// Outcome of an action on one robot.
#[derive(Debug, Serialize, utoipa::ToSchema)]
struct ActionOutcome {
    /// Robot of the outcome.
    robot: RobotId,
    /// True if the action was done.
    done: bool,
    /// Number of the proposal that was made or decided.
    #[serde(skip_serializing_if = "Option::is_none")]
    proposal: Option<ProposalId>,
    /// Problem with which the single call would have been answered.
    #[serde(skip_serializing_if = "Option::is_none")]
    problem: Option<Problem>,
}

/// Acts on many robots.
///
/// Each robot is decided on its own, by the rules of the action's single call and with a row of
/// the audit; a refused one does not affect the others. The caller needs the role of the single
/// call. An action that proposes needs an `Idempotency-Key`. If the database is slow, robots whose
/// turn does not come in time have the problem `not_tried`, and those under way `outcome_unknown`.
#[utoipa::path(
    post,
    path = "/fleet/actions",
    tag = "robots",
    params(("Idempotency-Key" = Option<String>, Header,
        description = "The same for each repetition of a request that proposes, at most 128 characters.")),
    request_body = ActionBody,
    responses(
        (status = OK, description = "The outcome of each robot", body = ActionAnswer),
        (status = PRECONDITION_REQUIRED,
            description = "The action proposes, and the `Idempotency-Key` is missing"),
    )
)]
pub(super) async fn act(
    State(api): State<ApiState>,
    caller: Caller,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    headers: HeaderMap,
    Body {
        value: ActionBody { action, robots },
        sha256,
    }: Body<ActionBody, { limits::BULK_BODY_BYTES_MAX }>,
) -> Result<Json<ActionAnswer>, Problem> {
    check_role(&caller, &action)?;
    check_targets(&robots)?;
    let key = match action {
        Action::Propose(_) => Some(required_key(&headers, sha256)?),
        _ => None,
    };
    // The request itself counts as one.
    let further = u32::try_from(robots.len() - 1).unwrap_or(u32::MAX);
    access::count_writes(&api, &caller, further)?;
    let ids: Vec<_> = robots.iter().map(|robot| robot.id.clone()).collect();
    let acting = |target| taken(&api, &caller, (&action, key.as_ref()), target);
    let decided = each(robots, acting).await;
    let items: Vec<_> = ids.into_iter().zip(decided).map(outcome).collect();
    let done = items.iter().filter(|item| item.done).count();
    Ok(Json(ActionAnswer {
        done,
        refused: items.len() - done,
        items,
    }))
}

fn outcome((robot, decided): (RobotId, Result<Option<ProposalId>, Problem>)) -> ActionOutcome {
    let (proposal, problem) = match decided {
        Ok(proposal) => (proposal, None),
        Err(problem) => (None, Some(problem)),
    };
    ActionOutcome {
        robot,
        done: problem.is_none(),
        proposal,
        problem,
    }
}

impl Action {
    /// Method and path of the single call, whose permission the action needs.
    const fn single_call(&self) -> (Method, &'static str) {
        match self {
            Self::Maintenance(_) => (Method::PUT, "/api/v1/robots/{id}/maintenance"),
            Self::Acknowledge(_) => (Method::POST, "/api/v1/alerts/{id}/ack"),
            Self::Propose(_) => (Method::POST, "/api/v1/proposals"),
            Self::Approve(_) => (Method::POST, "/api/v1/proposals/{id}/approve"),
            Self::Reject(_) => (Method::POST, "/api/v1/proposals/{id}/reject"),
            Self::Retire(_) => (Method::DELETE, "/api/v1/robots/{id}"),
            Self::BringBack(_) => (Method::POST, "/api/v1/robots/{id}/bring-back"),
        }
    }
}

/// Refuses a caller whose role does not permit the single call.
fn check_role(caller: &Caller, action: &Action) -> Result<(), Problem> {
    let (method, path) = action.single_call();
    match access::of_route(&method, path) {
        Some(access) if access.permits(&caller.grant, None) => Ok(()),
        access => {
            let role = caller.grant.role().as_str();
            let accepted = access.map_or("nobody", |access| access.accepted());
            let detail = format!("your role: got {role}, expected {accepted}");
            Err(Problem::new(StatusCode::FORBIDDEN, "not_permitted", detail))
        }
    }
}

/// Refuses too few or too many robots, one that is named twice, and too many alerts of one.
fn check_targets(robots: &[Target]) -> Result<(), Problem> {
    let refused = |detail: String| {
        Problem::new(StatusCode::BAD_REQUEST, "value_refused", detail).of_field("robots")
    };
    let (count, max) = (robots.len(), limits::ACTED_AT_ONCE_MAX);
    if count == 0 || count > max {
        return Err(refused(format!(
            "{count} robots are named, expected 1 to {max}"
        )));
    }
    let mut named = BTreeSet::new();
    for robot in robots {
        if !named.insert(&robot.id) {
            return Err(refused(format!(
                "{} is named twice, expected each robot once",
                robot.id
            )));
        }
        let (count, max) = (robot.alerts.len(), limits::ACKNOWLEDGED_OF_ROBOT_MAX);
        if count > max {
            return Err(refused(format!(
                "{count} alerts of {} are named, expected {max} at most",
                robot.id
            )));
        }
    }
    Ok(())
}

/// Acts on one robot; returns the proposal that was made or decided.
async fn taken(
    api: &ApiState,
    caller: &Caller,
    (action, key): (&Action, Option<&IdempotencyKey>),
    target: Target,
) -> Result<Option<ProposalId>, Problem> {
    match action.clone() {
        Action::Maintenance(body) => maintain(api, caller, &target.id, body).await.map(|()| None),
        Action::Retire(body) => retire(api, caller, &target.id, body.reason)
            .await
            .map(|()| None),
        Action::BringBack(body) => bring_back(api, caller, &target.id, body.reason)
            .await
            .map(|()| None),
        Action::Acknowledge(body) => acknowledge_each(api, caller, target, body).await,
        Action::Propose(ReasonBody { reason }) => {
            let key = key.cloned().ok_or_else(Problem::panicked)?;
            let proposal = NewProposalDocument {
                robot: target.id,
                values: None,
                reason,
            };
            propose(api, caller, &proposal, key).await.map(Some)
        }
        Action::Approve(ApproveBody { reason }) => {
            let read = read_proposal(api, target).await?;
            let given = reason.clone().unwrap_or_default();
            let command = Command::Approve {
                proposal: read.id,
                version: Some(read.version),
                sha256: read
                    .sha256
                    .ok_or_else(|| missing("robots.proposal.sha256"))?,
                reason,
            };
            close(api, caller, read.id, &given, command).await?;
            Ok(Some(read.id))
        }
        Action::Reject(ReasonBody { reason }) => {
            let read = read_proposal(api, target).await?;
            let command = Command::Reject {
                proposal: read.id,
                version: Some(read.version),
                reason: reason.clone(),
            };
            close(api, caller, read.id, &reason, command).await?;
            Ok(Some(read.id))
        }
    }
}

/// Proposal that the caller read, which must be the robot's.
async fn read_proposal(api: &ApiState, target: Target) -> Result<ReadProposal, Problem> {
    let read = target.proposal.ok_or_else(|| missing("robots.proposal"))?;
    if robot_of(api, read.id).await? == target.id {
        return Ok(read);
    }
    let accepted = format!("a proposal of robot {}", target.id);
    Err(Problem::refused(
        "robots.proposal.id",
        &read.id.to_string(),
        &accepted,
    ))
}

/// Acknowledges the alerts of a robot that the caller read, all or none.
async fn acknowledge_each(
    api: &ApiState,
    caller: &Caller,
    target: Target,
    body: AcknowledgementBody,
) -> Result<Option<ProposalId>, Problem> {
    if target.alerts.is_empty() {
        return Err(missing("robots.alerts"));
    }
    for ReadAlert { id, .. } in &target.alerts {
        let found = api.store.alert(*id).await?;
        if found.is_some_and(|(alert, _)| !alert.is_about(&target.id)) {
            let accepted = format!("an alert of robot {}", target.id);
            return Err(Problem::refused(
                "robots.alerts.id",
                &id.to_string(),
                &accepted,
            ));
        }
    }
    let read = target.alerts.into_iter();
    let read: Vec<_> = read
        .map(|ReadAlert { id, version }| (id, version))
        .collect();
    acknowledge(api, caller, &read, body).await?;
    Ok(None)
}

/// Problem of a robot without what the action needs of it.
fn missing(field: &str) -> Problem {
    let detail = format!("{field}: got none, expected what was read of the robot");
    Problem::new(StatusCode::BAD_REQUEST, "value_refused", detail).of_field(field)
}
