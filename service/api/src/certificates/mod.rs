//! Routes of the certificates of verified calibrations.

mod list;
mod one;

use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::ApiState;

/// Routes of certificates.
pub(super) fn routes() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new()
        .routes(routes!(list::list_certificates))
        .routes(routes!(one::get_certificate))
}
