//! Route `GET /views/robots`: ids of the robots of a view, for clients that have the robots already.

use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use fleetcal_domain::approval::RobotLedger;
use fleetcal_domain::deviation::Deviation;
use fleetcal_domain::robot::RobotView;
use fleetcal_domain::standing::Standing;
use fleetcal_model::WallTime;
use fleetcal_proto::RobotId;
use fleetcal_view::{Properties, Query, Sort};
use serde::{Deserialize, Serialize};

use crate::ApiState;
use crate::extract::Parameters;
use crate::problem::Problem;

/// Robot with the facts that views need.
pub(crate) struct Listed {
    pub(super) view: RobotView,
    pub(crate) ledger: Arc<RobotLedger>,
    pub(super) standing: Standing,
    pub(super) deviation: Option<Deviation>,
    now: WallTime,
}

impl Listed {
    /// Present facts about the robot of a view.
    pub(super) fn of(api: &ApiState, view: RobotView, now: WallTime) -> Self {
        Self::by(api, &api.evaluator.standings(), view, now)
    }

    fn by(
        api: &ApiState,
        standings: &fleetcal_operations::alert_evaluator::Standings,
        view: RobotView,
        now: WallTime,
    ) -> Self {
        let ledger = api.lifecycle.ledger(&view.id);
        Self {
            standing: standings.of(&view, &ledger),
            deviation: standings.deviation(&view, &ledger),
            ledger,
            view,
            now,
        }
    }

    /// Properties that views select and sort by.
    pub(crate) fn properties(&self) -> Properties<'_> {
        let Self {
            view,
            ledger,
            standing,
            deviation,
            now,
        } = self;
        Properties::of(view, ledger, *standing, *deviation, *now)
    }
}

/// Robots that a query selects; retired ones are in no view.
pub(crate) fn in_view(api: &ApiState, query: &Query, now: WallTime) -> Vec<Listed> {
    let standings = api.evaluator.standings();
    let robots = api.fleet.robots().into_iter();
    let listed = robots.map(|view| Listed::by(api, &standings, view, now));
    listed
        .filter(|robot| robot.ledger.shadow.retired.is_none())
        .filter(|robot| query.selects(&robot.properties()))
        .collect()
}

/// Parses `q`; without it every robot is selected.
pub(crate) fn query_of(text: Option<&str>) -> Result<Query, Problem> {
    let query = text.unwrap_or_default().parse::<Query>();
    query.map_err(|refused| {
        let detail = format!("q: {refused}");
        Problem::new(StatusCode::BAD_REQUEST, "value_refused", detail).of_field("q")
    })
}

/// Parses `sort`; by id without it.
pub(super) fn sort_of(text: Option<&str>) -> Result<Sort, Problem> {
    let Some(text) = text else {
        return Ok(Sort::default());
    };
    let refused = |_| Problem::refused("sort", text, &Sort::accepted());
    text.parse().map_err(refused)
}

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct ViewParameters {
    /// Query for the robots, such as `model:tricycle site:hamburg deviation>1`; all robots unless
    /// given.
    #[param(max_length = 2000)]
    q: Option<String>,
    /// Order, as in `GET /robots`; by id unless given.
    sort: Option<String>,
}

/// Robots of a view.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct RobotsOfView {
    /// Query as the service writes it: equal queries have one text.
    q: String,
    /// Order as the service writes it.
    sort: String,
    /// Ids of the robots, in this order.
    #[schema(value_type = Vec<RobotId>)]
    robots: Vec<RobotId>,
}

/// Returns the ids of the robots of a view, in its order.
#[utoipa::path(
    get,
    path = "/views/robots",
    tag = "robots",
    params(ViewParameters),
    responses(
        (status = OK, description = "The robots of the view", body = RobotsOfView),
    )
)]
pub(super) async fn get_view(
    State(api): State<ApiState>,
    Parameters(parameters): Parameters<ViewParameters>,
) -> Result<Json<RobotsOfView>, Problem> {
    let query = query_of(parameters.q.as_deref())?;
    let sort = sort_of(parameters.sort.as_deref())?;
    let mut robots = in_view(&api, &query, api.clock.now());
    robots.sort_by_cached_key(|robot| sort.position(&robot.properties()));
    Ok(Json(RobotsOfView {
        q: query.to_string(),
        sort: sort.to_string(),
        robots: robots.into_iter().map(|robot| robot.view.id).collect(),
    }))
}
