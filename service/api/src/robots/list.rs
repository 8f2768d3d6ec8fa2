//! `GET /robots`: every robot, the worst first.

use std::collections::BTreeMap;

use axum::Json;
use axum::extract::State;
use fleetcal_domain::robot::{ConnectionState, RobotState, RobotView};
use serde::{Deserialize, Serialize};

use super::connection::connection_state;
use super::document::RobotSummary;
use crate::ApiState;
use crate::extract::Parameters;
use crate::page::{cut, page_limit};
use crate::problem::Problem;

/// Where a robot stands in a list that shows the worst first.
const fn severity(state: RobotState) -> u8 {
    match state {
        RobotState::Failed => 0,
        RobotState::Changed => 1,
        RobotState::NoData => 2,
        RobotState::Unregistered => 3,
        RobotState::Learning => 4,
        RobotState::Calibrated => 5,
    }
}

const STATES: [RobotState; 6] = [
    RobotState::Failed,
    RobotState::Changed,
    RobotState::NoData,
    RobotState::Unregistered,
    RobotState::Learning,
    RobotState::Calibrated,
];

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct ListParameters {
    /// Only robots in this state.
    #[param(value_type = Option<RobotState>)]
    state: Option<String>,
    /// Only robots that are heard like this.
    #[param(value_type = Option<ConnectionState>)]
    connection: Option<String>,
    /// `severity` (the worst first, then by id) or `id`; by id unless given.
    #[param(value_type = Option<SortSchema>)]
    sort: Option<String>,
    /// Robots of a page, 1 to 1000.
    #[param(value_type = Option<u32>)]
    limit: Option<String>,
    /// `next` of the page before.
    cursor: Option<String>,
}

/// The order of a list of robots.
#[derive(utoipa::ToSchema)]
#[schema(as = RobotSort, rename_all = "snake_case")]
#[expect(dead_code, reason = "a schema")]
pub(crate) enum SortSchema {
    /// The worst first, then by id.
    Severity,
    /// By id.
    Id,
}

/// A page of robots.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct RobotPage {
    /// The robots.
    items: Vec<RobotSummary>,
    /// `cursor` of the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
    /// How many robots are in each state, whatever was asked for.
    #[schema(value_type = BTreeMap<String, usize>)]
    counts: BTreeMap<&'static str, usize>,
    /// How many robots are heard how, whatever was asked for.
    #[schema(value_type = BTreeMap<String, usize>)]
    connections: BTreeMap<&'static str, usize>,
}

/// Lists the robots: those that are configured, and those that send without being configured.
#[utoipa::path(
    get,
    path = "/robots",
    tag = "robots",
    params(ListParameters),
    responses(
        (status = OK, description = "A page of robots", body = RobotPage),
    )
)]
pub(super) async fn list_robots(
    State(api): State<ApiState>,
    Parameters(query): Parameters<ListParameters>,
) -> Result<Json<RobotPage>, Problem> {
    let state = query.state.as_deref().map(state_named).transpose()?;
    let connection = query.connection.as_deref();
    let connection = connection.map(connection_named).transpose()?;
    let by_severity = match query.sort.as_deref() {
        None | Some("id") => false,
        Some("severity") => true,
        Some(other) => return Err(Problem::refused("sort", other, "severity or id")),
    };
    let limit = page_limit(query.limit.as_deref())?;
    let after = query.cursor.as_deref().map(position_of).transpose()?;

    let now_ns = api.clock.now_ns();
    let robots = api.fleet.robots();
    let counts = counts(&robots);
    let heard =
        |robot: &RobotView| connection_state(robot, &api.lifecycle.ledger(&robot.id), now_ns);
    let connections = connections(robots.iter().map(heard));
    let place = |robot: &RobotView| {
        let rank = if by_severity {
            severity(robot.state)
        } else {
            0
        };
        (rank, robot.id.as_str().to_owned())
    };
    let mut chosen: Vec<_> = robots
        .into_iter()
        .filter(|robot| state.is_none_or(|state| robot.state == state))
        .filter(|robot| connection.is_none_or(|connection| heard(robot) == connection))
        .map(|robot| (place(&robot), robot))
        .filter(|(place, _)| after.as_ref().is_none_or(|after| place > after))
        .collect();
    chosen.sort_by(|(a, _), (b, _)| a.cmp(b));
    let next = cut(&mut chosen, limit, |((rank, id), _)| format!("{rank}.{id}"));
    let items = chosen
        .into_iter()
        .map(|(_, robot)| {
            let ledger = api.lifecycle.ledger(&robot.id);
            RobotSummary::of(robot, &ledger, now_ns)
        })
        .collect();
    Ok(Json(RobotPage {
        items,
        next,
        counts,
        connections,
    }))
}

fn connections(heard: impl Iterator<Item = ConnectionState>) -> BTreeMap<&'static str, usize> {
    let all = ConnectionState::ALL.iter();
    let mut counts: BTreeMap<_, _> = all.map(|one| (one.name(), 0)).collect();
    for connection in heard {
        *counts.entry(connection.name()).or_default() += 1;
    }
    counts
}

fn connection_named(name: &str) -> Result<ConnectionState, Problem> {
    let mut all = ConnectionState::ALL.iter().copied();
    all.find(|one| one.name() == name)
        .ok_or_else(|| Problem::refused("connection", name, "one of online, silent, maintenance"))
}

fn counts(robots: &[RobotView]) -> BTreeMap<&'static str, usize> {
    let mut counts: BTreeMap<_, _> = STATES.iter().map(|state| (state.name(), 0)).collect();
    for robot in robots {
        *counts.entry(robot.state.name()).or_default() += 1;
    }
    counts
}

fn state_named(name: &str) -> Result<RobotState, Problem> {
    STATES
        .into_iter()
        .find(|state| state.name() == name)
        .ok_or_else(|| {
            let accepted = STATES.map(RobotState::name).join(", ");
            Problem::refused("state", name, &format!("one of {accepted}"))
        })
}

/// The place in the list that a cursor names.
fn position_of(cursor: &str) -> Result<(u8, String), Problem> {
    let position = cursor.split_once('.').and_then(|(rank, id)| {
        let rank = rank.parse().ok()?;
        Some((rank, id.to_owned()))
    });
    position.ok_or_else(|| Problem::refused("cursor", cursor, "`next` of the page before"))
}
