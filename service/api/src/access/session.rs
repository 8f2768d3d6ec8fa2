//! `/session`: signing in and out, and changing one's own password.

use axum::Json;
use axum::extract::State;
use axum::http::request::Parts;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use fleetcal_domain::access::{
    Actor, Authentication, HttpRequest, SecretHash, SessionSpan, SessionValue,
};
use fleetcal_http::PeerAddress;
use fleetcal_operations::accounts::{UserChange, UserEdit, change_user};
use fleetcal_operations::entropy;
use fleetcal_store::{Credential, Expected, UserRecord};
use serde::Deserialize;

use super::caller::{Caller, http_request};
use super::document::{CredentialKind, SessionDocument};
use super::sign_in::verified;
use crate::ApiState;
use crate::extract::{Body, NoParameters, Parameters};
use crate::password::failed;
use crate::problem::Problem;
use crate::time;

/// Name of a user, with the password.
#[derive(Deserialize, utoipa::ToSchema)]
#[schema(as = SignIn)]
#[serde(deny_unknown_fields)]
pub(super) struct SignInDocument {
    name: String,
    #[schema(format = Password)]
    password: String,
}

/// Signs in: the answer sets the session's cookie.
///
/// A session ends after twelve hours without use, and after seven days in any case.
#[utoipa::path(
    post,
    path = "/session",
    tag = "access",
    security(()),
    request_body = SignInDocument,
    responses(
        (status = CREATED, description = "The new session; its cookie is set",
            body = SessionDocument, headers(("Set-Cookie" = String, description = "The session."))),
        (status = UNAUTHORIZED, description = "The name or the password is wrong"),
        (status = TOO_MANY_REQUESTS,
            description = "Too many attempts; `Retry-After` has the time to wait"),
    )
)]
pub(super) async fn sign_in(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    peer: PeerAddress,
    OfRequest(request): OfRequest,
    Body { value: body, .. }: Body<SignInDocument>,
) -> Result<Response, Problem> {
    let user = verified(&api, peer, &body.name, body.password).await?;
    let session = new_session()?;
    let change = UserChange::SignIn {
        id: user.id,
        version: user.version,
        session: session.hash(),
    };
    let actor = Actor {
        name: user.name.to_string(),
        authentication: Authentication::Session,
        role: Some(user.grant.role()),
        request: Some(request),
    };
    let written = change_user(&api.store, actor, change).await?;
    Ok(begun(&api, &written.record, &session))
}

/// Makes a new session's value.
pub(super) fn new_session() -> Result<SessionValue, Problem> {
    let random = entropy::secret().map_err(|error| failed(&error))?;
    Ok(SessionValue::new(&random))
}

/// Answer that gives a browser its session.
pub(super) fn begun(api: &ApiState, user: &UserRecord, session: &SessionValue) -> Response {
    let now = api.clock.now();
    let span = SessionSpan {
        created_ns: now,
        used_ns: now,
    };
    let document = SessionDocument {
        name: user.name.to_string(),
        role: user.grant.role(),
        credential: CredentialKind::Session,
        ends: Some(time::of(span.ends())),
    };
    let headers = [
        (header::SET_COOKIE, api.access.cookies.set(session)),
        (header::CACHE_CONTROL, HeaderValue::from_static("no-store")),
    ];
    (StatusCode::CREATED, headers, Json(document)).into_response()
}

/// Record of a request, for the audit of actions without a known caller.
#[derive(Debug)]
pub(super) struct OfRequest(pub(super) HttpRequest);

impl<S: Send + Sync> axum::extract::FromRequestParts<S> for OfRequest {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Problem> {
        Ok(Self(http_request(parts)))
    }
}

/// Returns the caller: the user who is signed in, or the token.
#[utoipa::path(
    get,
    path = "/session",
    tag = "access",
    responses(
        (status = OK, description = "The caller", body = SessionDocument),
        (status = UNAUTHORIZED,
            description = "No valid credential; `code` is `setup_required` while there are no users"),
    )
)]
pub(super) async fn get_session(
    Parameters(NoParameters {}): Parameters<NoParameters>,
    caller: Caller,
) -> Json<SessionDocument> {
    Json(SessionDocument::of(caller))
}

/// Signs out: ends the session and removes its cookie.
#[utoipa::path(
    delete,
    path = "/session",
    tag = "access",
    responses(
        (status = NO_CONTENT, description = "The session is ended and its cookie removed"),
    )
)]
pub(super) async fn sign_out(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    caller: Caller,
) -> Result<Response, Problem> {
    let session = session_of(&caller)?;
    let change = UserChange::SignOut { session };
    change_user(&api.store, caller.actor, change).await?;
    let cleared = [(header::SET_COOKIE, api.access.cookies.clear())];
    Ok((StatusCode::NO_CONTENT, cleared).into_response())
}

/// Change of one's own password.
#[derive(Deserialize, utoipa::ToSchema)]
#[schema(as = PasswordChange)]
#[serde(deny_unknown_fields)]
pub(super) struct PasswordChangeDocument {
    #[schema(format = Password)]
    current: String,
    /// New password, 12 to 128 characters.
    #[schema(format = Password, min_length = 12, max_length = 128)]
    password: String,
}

/// Changes the caller's own password.
///
/// The caller's other sessions end.
#[utoipa::path(
    post,
    path = "/session/password",
    tag = "access",
    request_body = PasswordChangeDocument,
    responses(
        (status = NO_CONTENT, description = "The password is changed"),
        (status = CONFLICT, description = "The current password is wrong"),
        (status = TOO_MANY_REQUESTS,
            description = "Too many attempts; `Retry-After` has the time to wait"),
    )
)]
pub(super) async fn change_password(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    peer: PeerAddress,
    caller: Caller,
    Body { value: body, .. }: Body<PasswordChangeDocument>,
) -> Result<StatusCode, Problem> {
    let session = session_of(&caller)?;
    let user = verified(&api, peer, &caller.actor.name, body.current)
        .await
        .map_err(wrong_current)?;
    let edit = UserEdit {
        password: Some(api.access.passwords.hash(&body.password).await?),
        ..UserEdit::default()
    };
    let change = UserChange::Edit {
        id: user.id,
        expected: Expected::Version(user.version),
        edit,
        keep: Some(session),
    };
    change_user(&api.store, caller.actor, change).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Converts the problem of a wrong current password to a 409: with a 401 a client would treat the
/// session as ended.
fn wrong_current(problem: Problem) -> Problem {
    if problem.status() == StatusCode::UNAUTHORIZED {
        let detail = "the current password is wrong";
        Problem::new(StatusCode::CONFLICT, "password_wrong", detail).of_field("current")
    } else {
        problem
    }
}

fn session_of(caller: &Caller) -> Result<SecretHash, Problem> {
    match caller.credential {
        Credential::Session(session) => Ok(session),
        Credential::Token(_) => {
            let detail = "this is for people who signed in, not for tokens";
            Err(Problem::new(
                StatusCode::BAD_REQUEST,
                "not_a_session",
                detail,
            ))
        }
    }
}
