//! `/policy`: when something is proposed, who has to agree, and when it counts as proven.

use axum::Json;
use axum::extract::State;

use crate::api::ApiState;
use crate::api::extract::{NoParameters, Parameters};
use crate::approval::Policy;

/// Gives what `[approval]` in `fleetcal.toml` says, defaults included.
#[utoipa::path(get, path = "/policy", tag = "approval",
    responses((status = OK, body = Policy)))]
pub(super) async fn get_policy(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Json<Policy> {
    Json(*api.clerk.policy())
}
