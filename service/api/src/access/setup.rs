//! Route `POST /setup`: the first administrator.

use axum::extract::State;
use axum::http::StatusCode;
use axum::response::Response;
use fleetcal_domain::access::{AccountRefused, Actor, Authentication, Role, SecretHash};
use fleetcal_http::PeerAddress;
use fleetcal_operations::accounts::{UserChange, change_user};
use serde::Deserialize;

use super::document::SessionDocument;
use super::session::{OfRequest, begun, new_session};
use super::sign_in::too_many;
use super::users::checked_name;
use crate::ApiState;
use crate::extract::{Body, NoParameters, Parameters};
use crate::problem::Problem;

/// First administrator, to be created.
#[derive(Deserialize, utoipa::ToSchema)]
#[schema(as = Setup)]
#[serde(deny_unknown_fields)]
pub(super) struct SetupDocument {
    /// Code of the link that the service printed at its start.
    code: String,
    #[schema(max_length = 64)]
    name: String,
    /// Password, 12 to 128 characters.
    #[schema(format = Password, min_length = 12, max_length = 128)]
    password: String,
}

/// Creates the first administrator, signed in, with the code that a service without users prints at
/// its start.
///
/// The code is valid once, and for a day.
#[utoipa::path(
    post,
    path = "/setup",
    tag = "access",
    security(()),
    request_body = SetupDocument,
    responses(
        (status = CREATED, description = "The first administrator, signed in",
            body = SessionDocument, headers(("Set-Cookie" = String, description = "The session."))),
        (status = FORBIDDEN, description = "The setup code is wrong or has expired"),
        (status = CONFLICT, description = "There are users already"),
        (status = TOO_MANY_REQUESTS,
            description = "Too many attempts; `Retry-After` has the time to wait"),
    )
)]
pub(super) async fn set_up(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    peer: PeerAddress,
    OfRequest(request): OfRequest,
    Body { value: body, .. }: Body<SetupDocument>,
) -> Result<Response, Problem> {
    let access = &api.access;
    let counted = access.limits.count_address(peer, api.clock.elapsed());
    counted.map_err(too_many)?;
    if access.has_users(&api.store).await? {
        return Err(fleetcal_store::StoreError::from(AccountRefused::AlreadySetUp).into());
    }
    let now = api.clock.now();
    let code = api.store.setup_code(SecretHash::of(&body.code)).await?;
    if !code.is_some_and(|code| code.counts(now)) {
        let detail = "the setup code is wrong or older than a day; a service without users prints \
                      a new one at each start";
        let status = StatusCode::FORBIDDEN;
        return Err(Problem::new(status, "setup_code_refused", detail).of_field("code"));
    }
    let name = checked_name(&body.name)?;
    let password = access.passwords.hash(&body.password).await?;
    let session = new_session()?;
    let actor = Actor {
        name: name.to_string(),
        authentication: Authentication::SetupLink,
        role: Some(Role::Admin),
        request: Some(request),
    };
    let change = UserChange::SetUp {
        name,
        password,
        session: session.hash(),
    };
    let written = change_user(&api.store, actor, change).await?;
    Ok(begun(&api, &written.record, &session))
}
