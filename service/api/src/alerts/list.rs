//! Route `GET /alerts`: present and past problems of the robots.

use axum::Json;
use axum::extract::State;
use fleetcal_domain::alert::{AlertDocument, ConditionName};
use fleetcal_proto::RobotId;
use fleetcal_store::{AlertFilter, AlertSelection};
use serde::{Deserialize, Serialize};

use crate::ApiState;
use crate::extract::Parameters;
use crate::page::{cut, page_limit, with_next};
use crate::problem::Problem;

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct AlertParameters {
    /// State of the alerts: `active` (all but `normal`), or one of `pending`, `alerting`,
    /// `recovering`, `no_data`, and `normal` for ended ones.
    state: Option<String>,
    /// Robot of the alerts.
    #[param(value_type = Option<RobotId>)]
    robot: Option<String>,
    /// Alerts of a page, 1 to 1000.
    #[param(value_type = Option<u32>)]
    limit: Option<String>,
    /// Value of `next` of the previous page.
    cursor: Option<String>,
}

/// A page of alerts, the most urgent first.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct AlertPage {
    items: Vec<AlertDocument>,
    /// Value of `cursor` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
}

/// Lists alerts: active ones first, by kind, the worst first; then pending ones; then ended ones,
/// the newest first.
#[utoipa::path(
    get,
    path = "/alerts",
    tag = "alerts",
    params(AlertParameters),
    responses(
        (status = OK, description = "A page of alerts", body = AlertPage),
    )
)]
pub(super) async fn list_alerts(
    State(api): State<ApiState>,
    Parameters(query): Parameters<AlertParameters>,
) -> Result<Json<AlertPage>, Problem> {
    let limit = page_limit(query.limit.as_deref())?;
    let filter = AlertFilter {
        robot: query.robot.as_deref().map(robot_named).transpose()?,
        selection: query.state.as_deref().map(selection).transpose()?,
        after: query.cursor.as_deref().map(place_of).transpose()?,
        limit: with_next(limit),
    };
    let mut found = api.store.alerts(&filter).await?;
    let next = cut(&mut found, limit, |last| {
        format!("{}-{}", last.rank(), last.id())
    });
    let items = found.iter().map(AlertDocument::of_stored).collect();
    Ok(Json(AlertPage { items, next }))
}

fn selection(name: &str) -> Result<AlertSelection, Problem> {
    if name == "active" {
        return Ok(AlertSelection::Active);
    }
    let state = ConditionName::parse(name).map(AlertSelection::In);
    state.ok_or_else(|| {
        let accepted: Vec<&str> = ConditionName::ALL.iter().map(|one| one.as_str()).collect();
        let accepted = accepted.join(", ");
        Problem::refused("state", name, &format!("active or one of {accepted}"))
    })
}

/// Rank and number in a cursor.
fn place_of(cursor: &str) -> Result<(u32, i64), Problem> {
    let place = cursor
        .split_once('-')
        .and_then(|(rank, id)| Some((rank.parse().ok()?, id.parse().ok()?)));
    place.ok_or_else(|| Problem::refused("cursor", cursor, "`next` of the page before"))
}

fn robot_named(id: &str) -> Result<RobotId, Problem> {
    RobotId::parse(id).map_err(|error| {
        let status = axum::http::StatusCode::BAD_REQUEST;
        Problem::new(status, "value_refused", error.to_string()).of_field("robot")
    })
}
