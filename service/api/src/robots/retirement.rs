//! Retirement of robots: `DELETE /robots/{id}`, `POST /robots/{id}/bring-back`, and
//! `GET /fleet/retired`.

use axum::Json;
use axum::extract::State;
use fleetcal_domain::approval::{Command, Retirement};
use fleetcal_domain::limits;
use fleetcal_fleet::FleetRefused;
use fleetcal_proto::RobotId;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::ApiState;
use crate::access::Caller;
use crate::approval::ReasonBody;
use crate::extract::{Body, NoParameters, Parameters, RobotPath, check_length};
use crate::page::{cut, page_limit};
use crate::problem::Problem;
use crate::time;

/// Retired robot.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = RetiredRobot)]
pub(super) struct RetiredDocument {
    /// Id of the robot.
    robot: RobotId,
    #[serde(flatten)]
    retirement: RetirementDocument,
}

/// Retirement: the robot has left the fleet. Its records stay, and its messages are refused.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Retirement)]
pub(super) struct RetirementDocument {
    /// Person or tool that retired it.
    by: String,
    /// Time of the retirement.
    #[schema(value_type = String, format = DateTime)]
    at: Timestamp,
    /// Reason for the retirement.
    reason: String,
}

impl RetirementDocument {
    pub(super) fn of(retirement: &Retirement) -> Self {
        Self {
            by: retirement.by.clone(),
            at: time::of(retirement.at_ns),
            reason: retirement.reason.clone(),
        }
    }
}

/// Page of retired robots, by id.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct RetiredPage {
    items: Vec<RetiredDocument>,
    /// Value of `cursor` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
}

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct RetiredParameters {
    /// Robots of a page, 1 to 1000.
    #[param(value_type = Option<u32>)]
    limit: Option<String>,
    /// Value of `next` of the previous page.
    cursor: Option<String>,
}

/// Lists the retired robots, by id.
#[utoipa::path(
    get,
    path = "/fleet/retired",
    tag = "robots",
    params(RetiredParameters),
    responses(
        (status = OK, description = "A page of retired robots", body = RetiredPage),
    )
)]
pub(super) async fn list_retired(
    State(api): State<ApiState>,
    Parameters(query): Parameters<RetiredParameters>,
) -> Result<Json<RetiredPage>, Problem> {
    let limit = page_limit(query.limit.as_deref())?;
    let after = query.cursor.as_deref().unwrap_or("");
    let ids = api.fleet.ids().into_iter();
    let retired = ids.filter(|id| id.as_str() > after).filter_map(|robot| {
        let retirement =
            RetirementDocument::of(api.lifecycle.ledger(&robot).shadow.retired.as_ref()?);
        Some(RetiredDocument { robot, retirement })
    });
    let mut items: Vec<_> = retired.collect();
    let next = cut(&mut items, limit, |last| last.robot.to_string());
    Ok(Json(RetiredPage { items, next }))
}

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct RetireParameters {
    /// Reason for the retirement, 1 to 1000 characters.
    reason: String,
}

/// Retires a robot, which has left the fleet.
///
/// Its history, audit and certificates stay; lists no longer contain it, it raises no alerts, and
/// its messages are refused and counted. An open proposal is withdrawn. A robot that sends, or has
/// a deployment under way, is refused.
#[utoipa::path(
    delete,
    path = "/robots/{id}",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot."), RetireParameters),
    responses(
        (status = OK, description = "The retired robot", body = RetiredDocument),
        (status = NOT_FOUND, description = "The robot is unknown"),
        (status = CONFLICT,
            description = "The robot is retired or not registered, it sends, or a deployment is under way"),
    )
)]
pub(super) async fn delete_robot(
    State(api): State<ApiState>,
    caller: Caller,
    RobotPath(id): RobotPath,
    Parameters(RetireParameters { reason }): Parameters<RetireParameters>,
) -> Result<Json<RetiredDocument>, Problem> {
    retire(&api, &caller, &id, reason).await?;
    let ledger = api.lifecycle.ledger(&id);
    let retired = ledger.shadow.retired.as_ref();
    // Somebody may have brought it back meanwhile.
    let retired = retired.ok_or(fleetcal_domain::approval::Refused::NotRetired)?;
    Ok(Json(RetiredDocument {
        retirement: RetirementDocument::of(retired),
        robot: id,
    }))
}

/// Brings a retired robot back.
///
/// Its estimate continues from the last stored state.
#[utoipa::path(
    post,
    path = "/robots/{id}/bring-back",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot.")),
    request_body = ReasonBody,
    responses(
        (status = NO_CONTENT, description = "The robot is back"),
        (status = NOT_FOUND, description = "The robot is unknown"),
        (status = CONFLICT, description = "The robot is not retired"),
    )
)]
pub(super) async fn bring_robot_back(
    State(api): State<ApiState>,
    caller: Caller,
    RobotPath(id): RobotPath,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    Body { value, .. }: Body<ReasonBody>,
) -> Result<axum::http::StatusCode, Problem> {
    bring_back(&api, &caller, &id, value.reason).await?;
    Ok(axum::http::StatusCode::NO_CONTENT)
}

/// Retires a registered robot.
pub(crate) async fn retire(
    api: &ApiState,
    caller: &Caller,
    id: &RobotId,
    reason: String,
) -> Result<(), Problem> {
    let view = api.fleet.robot(id);
    let view = view.ok_or_else(|| Problem::robot_unknown(id.as_str()))?;
    if view.config.is_none() {
        return Err(FleetRefused::Unregistered(id.clone()).into());
    }
    check_length("reason", &reason, limits::NOTE_CHARS_MAX)?;
    let command = Command::Retire { reason };
    let actor = caller.actor.clone();
    api.lifecycle.decide(id, command, actor, None).await?;
    Ok(())
}

/// Brings a retired robot back.
pub(crate) async fn bring_back(
    api: &ApiState,
    caller: &Caller,
    id: &RobotId,
    reason: String,
) -> Result<(), Problem> {
    let known = api.fleet.robot(id);
    known.ok_or_else(|| Problem::robot_unknown(id.as_str()))?;
    check_length("reason", &reason, limits::NOTE_CHARS_MAX)?;
    let command = Command::BringBack { reason };
    let actor = caller.actor.clone();
    api.lifecycle.decide(id, command, actor, None).await?;
    Ok(())
}
