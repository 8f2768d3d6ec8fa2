//! Roll-outs: staged deployments of pending proposals.

mod list;
mod one;
mod plan;
mod start;

use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::ApiState;

/// Routes under `/rollouts`.
pub(super) fn routes() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new()
        .routes(routes!(list::list_rollouts, start::start_rollout))
        .routes(routes!(one::get_rollout))
        .routes(routes!(one::pause_rollout))
        .routes(routes!(one::resume_rollout))
        .routes(routes!(one::halt_rollout))
}
