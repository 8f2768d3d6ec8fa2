//! Route `GET /robots`: the robots of a view, in its order, as pages or as a file.

use std::collections::BTreeMap;

use axum::Json;
use axum::body::Bytes;
use axum::extract::State;
use axum::response::{IntoResponse, Response};
use fleetcal_domain::robot::{ConnectionState, RobotState};
use fleetcal_domain::standing::Standing;
use fleetcal_http::csv;
use fleetcal_view::{COLUMNS, Position, Sort};
use futures::stream;
use serde::{Deserialize, Serialize};

use super::document::RobotSummary;
use super::view::{Listed, in_view, query_of, sort_of};
use crate::ApiState;
use crate::access::Caller;
use crate::cluster::Owners;
use crate::export::Export;
use crate::extract::Parameters;
use crate::page::{cut, page_limit};
use crate::problem::Problem;

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct ListParameters {
    /// Query for the robots, such as `model:tricycle site:hamburg deviation>1`; all robots unless
    /// given.
    #[param(max_length = 2000)]
    q: Option<String>,
    /// State of the robots.
    #[param(value_type = Option<RobotState>)]
    state: Option<String>,
    /// Standing of the robots.
    #[param(value_type = Option<Standing>)]
    standing: Option<String>,
    /// Connection state of the robots; those in maintenance, whether they send or not, for
    /// `maintenance`.
    #[param(value_type = Option<ConnectionState>)]
    connection: Option<String>,
    /// Order: `id`, `severity` (by standing, the most urgent first), `deviation`, `age` (time since
    /// the last message), `site`, `type` or `model`, with `-` before it for the opposite; robots
    /// without the property come last, equal ones by id. By id unless given.
    sort: Option<String>,
    /// Robots of a page, 1 to 1000.
    #[param(value_type = Option<u32>)]
    limit: Option<String>,
    /// Value of `next` of the previous page.
    cursor: Option<String>,
    /// Format: `json`, or `csv` for all robots of the view as a file; `json` unless given.
    #[param(value_type = Option<String>)]
    format: Option<String>,
}

/// Page of robots.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct RobotPage {
    /// Robots of the page.
    items: Vec<RobotSummary>,
    /// Value of `cursor` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
    /// Number of robots of `q` in each state, independent of the other filters.
    #[schema(value_type = BTreeMap<String, usize>)]
    counts: BTreeMap<&'static str, usize>,
    /// Number of robots of `q` of each standing, independent of the other filters.
    #[schema(value_type = BTreeMap<String, usize>)]
    standings: BTreeMap<&'static str, usize>,
    /// Number of robots of `q` of each connection state, independent of the other filters. A robot
    /// in maintenance that sends counts under both.
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
        (status = OK, description = "A page of robots; with `format=csv` a file",
            content((RobotPage = "application/json"), (String = "text/csv"))),
        (status = TOO_MANY_REQUESTS, description = "The caller fetches too many files"),
        (status = SERVICE_UNAVAILABLE,
            description = "Too many files are written, or the database is unavailable"),
    )
)]
pub(super) async fn list_robots(
    State(api): State<ApiState>,
    Parameters(parameters): Parameters<ListParameters>,
    caller: Caller,
) -> Result<Response, Problem> {
    let query = query_of(parameters.q.as_deref())?;
    let sort = sort_of(parameters.sort.as_deref())?;
    let filter = Filter::of(&parameters)?;
    let as_csv = match parameters.format.as_deref() {
        None | Some("json") => false,
        Some("csv") => true,
        Some(other) => return Err(Problem::refused("format", other, "json or csv")),
    };
    let limit = page_limit(parameters.limit.as_deref())?;
    let after = parameters.cursor.as_deref().map(position_of).transpose()?;

    let now = api.clock.now();
    let robots = in_view(&api, &query, now);
    if as_csv {
        let export = Export::begin(&api, caller)?;
        return Ok(as_file(export, in_order(&robots, filter, sort)));
    }
    let mut chosen = in_order(&robots, filter, sort);
    chosen.retain(|(place, _)| after.as_ref().is_none_or(|after| place > after));
    let next = cut(&mut chosen, limit, |(place, _)| place.to_string());
    let owners = Owners::now(&api.membership);
    let items = chosen.into_iter();
    let items = items.map(|(_, robot)| RobotSummary::of(robot, &owners, now));
    let page = RobotPage {
        items: items.collect(),
        next,
        counts: count(RobotState::ALL, &robots, RobotState::name, |robot, one| {
            robot.view.state == one
        }),
        standings: count(Standing::ALL, &robots, Standing::as_str, |robot, one| {
            robot.standing == one
        }),
        connections: count(
            ConnectionState::ALL,
            &robots,
            ConnectionState::name,
            |robot, one| robot.properties().is_connected(one),
        ),
    };
    Ok(Json(page).into_response())
}

/// Filters of the list beside its query.
#[derive(Clone, Copy)]
struct Filter {
    state: Option<RobotState>,
    standing: Option<Standing>,
    connection: Option<ConnectionState>,
}

impl Filter {
    fn of(parameters: &ListParameters) -> Result<Self, Problem> {
        let ListParameters {
            state,
            standing,
            connection,
            ..
        } = parameters;
        Ok(Self {
            state: named("state", state.as_deref(), RobotState::ALL, RobotState::name)?,
            standing: named(
                "standing",
                standing.as_deref(),
                Standing::ALL,
                Standing::as_str,
            )?,
            connection: named(
                "connection",
                connection.as_deref(),
                ConnectionState::ALL,
                ConnectionState::name,
            )?,
        })
    }

    fn passes(self, robot: &Listed) -> bool {
        let connected = |state| robot.properties().is_connected(state);
        self.state.is_none_or(|state| robot.view.state == state)
            && self.standing.is_none_or(|one| robot.standing == one)
            && self.connection.is_none_or(connected)
    }
}

/// Robots that pass a filter, with their positions in the list.
fn in_order(robots: &[Listed], filter: Filter, sort: Sort) -> Vec<(Position, &Listed)> {
    let passing = robots.iter().filter(|robot| filter.passes(robot));
    let placed = passing.map(|robot| (sort.position(&robot.properties()), robot));
    let mut placed: Vec<_> = placed.collect();
    placed.sort_by(|(a, _), (b, _)| a.cmp(b));
    placed
}

fn as_file(export: Export, robots: Vec<(Position, &Listed)>) -> Response {
    let rows = robots.into_iter().map(|(_, robot)| {
        let fields = fleetcal_view::fields(&robot.view, &robot.properties(), robot.deviation);
        csv::line(fields.iter().map(String::as_str))
    });
    let lines: Vec<String> = std::iter::once(csv::line(COLUMNS)).chain(rows).collect();
    let pieces = stream::iter(lines.into_iter().map(|line| Ok(Bytes::from(line))));
    csv::file(csv::CSV, "robots.csv", export.body(pieces))
}

/// Number of robots of each value; 0 for values without any.
fn count<T: Copy>(
    all: &[T],
    robots: &[Listed],
    name: fn(T) -> &'static str,
    is: fn(&Listed, T) -> bool,
) -> BTreeMap<&'static str, usize> {
    let count = |one: T| robots.iter().filter(|robot| is(robot, one)).count();
    all.iter().map(|one| (name(*one), count(*one))).collect()
}

/// Value of a filter by its name.
fn named<T: Copy>(
    field: &str,
    text: Option<&str>,
    all: &[T],
    name: fn(T) -> &'static str,
) -> Result<Option<T>, Problem> {
    let Some(text) = text else {
        return Ok(None);
    };
    let found = all.iter().copied().find(|one| name(*one) == text);
    found.map(Some).ok_or_else(|| {
        let accepted: Vec<_> = all.iter().map(|one| name(*one)).collect();
        Problem::refused(field, text, &format!("one of {}", accepted.join(", ")))
    })
}

/// Position in the list that a cursor names.
fn position_of(cursor: &str) -> Result<Position, Problem> {
    let refused = || Problem::refused("cursor", cursor, "`next` of the page before");
    cursor.parse().map_err(|_| refused())
}
