//! Route `GET /rollouts`.

use axum::Json;
use axum::extract::State;
use fleetcal_documents::{RolloutDocument, RolloutPage};
use fleetcal_rollout::RolloutState;
use fleetcal_store::RolloutFilter;
use serde::Deserialize;

use crate::ApiState;
use crate::extract::{Parameters, number_of};
use crate::page::{cut, page_limit, with_next};
use crate::problem::Problem;

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct ListParameters {
    /// State of the roll-outs.
    #[param(value_type = Option<RolloutState>)]
    state: Option<String>,
    /// Roll-outs of a page, 1 to 1000.
    #[param(value_type = Option<u32>)]
    limit: Option<String>,
    /// Value of `next` of the previous page.
    cursor: Option<String>,
}

/// Lists the roll-outs, newest first, without their robots.
#[utoipa::path(get, path = "/rollouts", tag = "rollouts", params(ListParameters),
    responses((status = OK, description = "A page of roll-outs", body = RolloutPage)))]
pub(super) async fn list_rollouts(
    State(api): State<ApiState>,
    Parameters(parameters): Parameters<ListParameters>,
) -> Result<Json<RolloutPage>, Problem> {
    let ListParameters {
        state,
        limit,
        cursor,
    } = parameters;
    let parse = |name: String| {
        let accepted: Vec<_> = RolloutState::ALL.iter().map(|one| one.as_str()).collect();
        let accepted = format!("one of {}", accepted.join(", "));
        RolloutState::parse(&name).ok_or_else(|| Problem::refused("state", &name, &accepted))
    };
    let limit = page_limit(limit.as_deref())?;
    let filter = RolloutFilter {
        state: state.map(parse).transpose()?,
        before: cursor.as_deref().map(number_of).transpose()?,
        limit: with_next(limit),
    };
    let mut rollouts = api.store.rollouts(&filter).await?;
    let next = cut(&mut rollouts, limit, |rollout| rollout.id.to_string());
    let items = rollouts.into_iter();
    Ok(Json(RolloutPage {
        items: items.map(RolloutDocument::listed).collect(),
        next,
    }))
}
