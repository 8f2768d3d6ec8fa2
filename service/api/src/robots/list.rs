//! Route `GET /robots`: every robot, the worst first.

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use fleetcal_domain::approval::RobotLedger;
use fleetcal_domain::robot::{ConnectionState, RobotState, RobotView};
use fleetcal_domain::standing::Standing;
use fleetcal_model::WallTime;
use serde::{Deserialize, Serialize};

use super::connection::connection_state;
use super::document::RobotSummary;
use crate::ApiState;
use crate::cluster::Owners;
use crate::extract::Parameters;
use crate::page::{cut, page_limit};
use crate::problem::Problem;

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
    /// State of the robots.
    #[param(value_type = Option<RobotState>)]
    state: Option<String>,
    /// Standing of the robots.
    #[param(value_type = Option<Standing>)]
    standing: Option<String>,
    /// Connection state of the robots.
    #[param(value_type = Option<ConnectionState>)]
    connection: Option<String>,
    /// Order: `severity` (by standing, the most urgent first, then by id) or `id`; by id unless
    /// given.
    #[param(value_type = Option<SortSchema>)]
    sort: Option<String>,
    /// Robots of a page, 1 to 1000.
    #[param(value_type = Option<u32>)]
    limit: Option<String>,
    /// Value of `next` of the previous page.
    cursor: Option<String>,
}

/// Order of a list of robots.
#[derive(utoipa::ToSchema)]
#[schema(as = RobotSort, rename_all = "snake_case")]
#[expect(dead_code, reason = "a schema")]
pub(crate) enum SortSchema {
    /// Order by standing, the most urgent first, then by id.
    Severity,
    /// Order by id.
    Id,
}

/// Page of robots.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct RobotPage {
    /// Robots of the page.
    items: Vec<RobotSummary>,
    /// Value of `cursor` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
    /// Number of robots in each state, independent of the filters.
    #[schema(value_type = BTreeMap<String, usize>)]
    counts: BTreeMap<&'static str, usize>,
    /// Number of robots of each standing, independent of the filters.
    #[schema(value_type = BTreeMap<String, usize>)]
    standings: BTreeMap<&'static str, usize>,
    /// Number of robots of each connection state, independent of the filters.
    #[schema(value_type = BTreeMap<String, usize>)]
    connections: BTreeMap<&'static str, usize>,
}

/// Lists the robots: the configured ones, and those that send data without a configuration; not
/// the retired ones.
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
    let standing = query.standing.as_deref().map(standing_named).transpose()?;
    let connection = query.connection.as_deref();
    let connection = connection.map(connection_named).transpose()?;
    let by_severity = match query.sort.as_deref() {
        None | Some("id") => false,
        Some("severity") => true,
        Some(other) => return Err(Problem::refused("sort", other, "severity or id")),
    };
    let limit = page_limit(query.limit.as_deref())?;
    let after = query.cursor.as_deref().map(position_of).transpose()?;

    let now = api.clock.now();
    let robots = listed(&api, now);
    let counts = count_names(&STATES, &robots, RobotState::name, |one| one.view.state);
    let standings = count_names(Standing::ALL, &robots, Standing::as_str, |one| one.standing);
    let all = ConnectionState::ALL;
    let connections = count_names(all, &robots, ConnectionState::name, |one| one.heard);
    let place = |robot: &Listed| {
        let rank = if by_severity { robot.standing as u8 } else { 0 };
        (rank, robot.view.id.as_str().to_owned())
    };
    let mut chosen: Vec<_> = robots
        .into_iter()
        .filter(|robot| state.is_none_or(|state| robot.view.state == state))
        .filter(|robot| standing.is_none_or(|standing| robot.standing == standing))
        .filter(|robot| connection.is_none_or(|connection| robot.heard == connection))
        .map(|robot| (place(&robot), robot))
        .filter(|(place, _)| after.as_ref().is_none_or(|after| place > after))
        .collect();
    chosen.sort_by(|(a, _), (b, _)| a.cmp(b));
    let next = cut(&mut chosen, limit, |((rank, id), _)| format!("{rank}.{id}"));
    let owners = Owners::now(&api.membership);
    let items = chosen
        .into_iter()
        .map(|(_, robot)| {
            let (view, standing) = (robot.view, robot.standing);
            RobotSummary::of(view, &robot.ledger, standing, &owners, now)
        })
        .collect();
    Ok(Json(RobotPage {
        items,
        next,
        counts,
        standings,
        connections,
    }))
}

/// Robot with the properties that lists filter and sort by.
struct Listed {
    view: RobotView,
    ledger: Arc<RobotLedger>,
    standing: Standing,
    heard: ConnectionState,
}

fn listed(api: &ApiState, now: WallTime) -> Vec<Listed> {
    let standings = api.evaluator.standings();
    let robots = api.fleet.robots().into_iter();
    let listed = robots.filter_map(|view| {
        let ledger = api.lifecycle.ledger(&view.id);
        ledger.shadow.retired.is_none().then(|| Listed {
            standing: standings.of(&view, &ledger),
            heard: connection_state(&view, &ledger, now),
            view,
            ledger,
        })
    });
    listed.collect()
}

/// Number of robots of each value; 0 for values without any.
fn count_names<T: Copy>(
    all: &[T],
    robots: &[Listed],
    name: fn(T) -> &'static str,
    of: fn(&Listed) -> T,
) -> BTreeMap<&'static str, usize> {
    let mut counts: BTreeMap<_, _> = all.iter().map(|one| (name(*one), 0)).collect();
    for robot in robots {
        *counts.entry(name(of(robot))).or_default() += 1;
    }
    counts
}

fn standing_named(name: &str) -> Result<Standing, Problem> {
    Standing::parse(name).ok_or_else(|| {
        let accepted: Vec<_> = Standing::ALL.iter().map(|one| one.as_str()).collect();
        let accepted = accepted.join(", ");
        Problem::refused("standing", name, &format!("one of {accepted}"))
    })
}

fn connection_named(name: &str) -> Result<ConnectionState, Problem> {
    let mut all = ConnectionState::ALL.iter().copied();
    all.find(|one| one.name() == name)
        .ok_or_else(|| Problem::refused("connection", name, "one of online, silent, maintenance"))
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

/// Position in the list that a cursor names.
fn position_of(cursor: &str) -> Result<(u8, String), Problem> {
    let position = cursor.split_once('.').and_then(|(rank, id)| {
        let rank = rank.parse().ok()?;
        Some((rank, id.to_owned()))
    });
    position.ok_or_else(|| Problem::refused("cursor", cursor, "`next` of the page before"))
}
