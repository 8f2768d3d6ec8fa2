//! Routes of alerts and of their acknowledgement.

mod list;
mod one;

use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::ApiState;

pub(super) use one::{AcknowledgementBody, acknowledge};

/// Routes of alerts.
pub(super) fn routes() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new()
        .routes(routes!(list::list_alerts))
        .routes(routes!(one::get_alert))
        .routes(routes!(one::acknowledge_alert))
}
