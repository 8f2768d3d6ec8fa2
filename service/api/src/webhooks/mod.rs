//! Webhooks: programs that receive alerts and open proposals.

mod deliveries;
mod one;

use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::ApiState;

/// Routes of webhooks.
pub(super) fn routes() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new()
        .routes(routes!(one::list_webhooks, one::post_webhook))
        .routes(routes!(one::delete_webhook))
        .routes(routes!(deliveries::list_deliveries))
}
