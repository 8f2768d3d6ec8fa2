//! Routes about many robots: one action on each, and their registration.

mod actions;
mod entries;
mod import;

use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::ApiState;

/// Routes under `/fleet`.
pub(super) fn routes() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new()
        .routes(routes!(actions::act))
        .routes(routes!(import::import_robots))
}
