//! Route `GET /fleet/statistics`: statistics of the robots of a view, and what they have in common.

use axum::Json;
use axum::extract::State;
use fleetcal_model::WallTime;
use fleetcal_statistics::{
    CommonCause, GroupStatistics, Grouping, Member, Robot, Unlike, common_causes, groups, unlike,
};
use fleetcal_view::Query;
use serde::{Deserialize, Serialize};

use super::view::{Listed, in_view, query_of};
use crate::ApiState;
use crate::extract::Parameters;
use crate::problem::Problem;

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct StatisticsParameters {
    /// Query for the robots, such as `model:tricycle site:hamburg`; all robots unless given.
    #[param(max_length = 2000)]
    q: Option<String>,
    /// Property that the robots are grouped by: `site`, `type` or `tag`; `type` unless given.
    #[param(value_type = Option<Grouping>)]
    by: Option<String>,
}

/// Statistics of the robots of a view.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct StatisticsDocument {
    /// Query as the service writes it.
    q: String,
    /// Property that the groups share.
    by: Grouping,
    /// Time of the values, ns since 1970, wall time.
    at_ns: WallTime,
    /// Groups by their name; robots without the property are in none.
    groups: Vec<GroupStatistics>,
    /// Sites and tags whose robots differ from others of their kind by more than a tolerance, the
    /// least probable first; at most 16.
    common_causes: Vec<CommonCause>,
    /// Robots that differ from their kind by more than chance and a tolerance explain, the farthest
    /// first; robots of a common cause are left out.
    unlike: Vec<Unlike>,
}

/// Returns statistics of the robots of a view, with common causes and robots unlike their kind.
#[utoipa::path(
    get,
    path = "/fleet/statistics",
    tag = "robots",
    params(StatisticsParameters),
    responses(
        (status = OK, description = "The statistics", body = StatisticsDocument),
    )
)]
pub(super) async fn get_statistics(
    State(api): State<ApiState>,
    Parameters(parameters): Parameters<StatisticsParameters>,
) -> Result<Json<StatisticsDocument>, Problem> {
    let query = query_of(parameters.q.as_deref())?;
    let by = grouping_of(parameters.by.as_deref())?;
    let computed = tokio::task::spawn_blocking(move || statistics_of(&api, &query, by));
    computed.await.map(Json).map_err(|_| Problem::panicked())
}

/// Computes the statistics. It takes as long as reading every robot: not for the threads of the
/// runtime.
fn statistics_of(api: &ApiState, query: &Query, by: Grouping) -> StatisticsDocument {
    let at_ns = api.clock.now();
    let listed = in_view(api, query, at_ns);
    let of = |robot: &Listed| Member::of(&robot.view, &robot.ledger, robot.deviation);
    let members: Vec<Member> = listed.iter().map(of).collect();
    let robots: Vec<Robot> = members.iter().map(|one| one.robot.clone()).collect();
    let tolerances = api.lifecycle.policy().propose_beyond.limits();
    let common_causes = common_causes(&robots, tolerances);
    let explained: Vec<&str> = common_causes
        .iter()
        .flat_map(|cause| cause.robots.iter().map(String::as_str))
        .collect();
    StatisticsDocument {
        q: query.to_string(),
        by,
        at_ns,
        groups: groups(&members, by),
        unlike: unlike(&robots, &explained, tolerances),
        common_causes,
    }
}

fn grouping_of(text: Option<&str>) -> Result<Grouping, Problem> {
    match text {
        None | Some("type") => Ok(Grouping::Type),
        Some("site") => Ok(Grouping::Site),
        Some("tag") => Ok(Grouping::Tag),
        Some(text) => Err(Problem::refused("by", text, "site, type or tag")),
    }
}
