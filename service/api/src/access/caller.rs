//! Caller of a request: its credential, and the account behind it.

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, StatusCode, header};
use fleetcal_domain::access::{
    Access, Actor, Authentication, Grant, HttpRequest, SessionSpan, TokenState, TokenValue,
};
use fleetcal_domain::limits;
use fleetcal_http::PeerAddress;
use fleetcal_store::{Credential, StoreError};
use tower_http::request_id::RequestId;

use crate::ApiState;
use crate::problem::Problem;

/// Characters of a client's own request id that the audit keeps.
const REQUEST_ID_CHARS_MAX: usize = 64;

/// Caller of a request. A handler with this argument is called only if the table of permissions
/// admits the caller; [`Caller::actor`] is for the audit.
#[derive(Debug, Clone)]
pub(crate) struct Caller {
    /// Actor for the audit.
    pub(crate) actor: Actor,
    /// Grant of the caller.
    pub(crate) grant: Grant,
    /// Credential in the request.
    pub(crate) credential: Credential,
    /// Begin and last use of the session.
    pub(super) session: Option<SessionSpan>,
    /// Requirement of the route.
    pub(super) route: Asked,
}

/// Requirement of a route.
#[derive(Debug, Clone)]
pub(super) struct Asked {
    /// Permission by the table.
    pub(super) access: Access,
    /// Robot that the path names.
    pub(super) robot: Option<String>,
}

impl Asked {
    /// True if a caller with `grant` may call the route.
    pub(super) fn permits(&self, grant: &Grant) -> bool {
        self.access.permits(grant, self.robot.as_deref())
    }
}

impl<S: Send + Sync> FromRequestParts<S> for Caller {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Problem> {
        parts.extensions.get::<Self>().cloned().ok_or_else(missing)
    }
}

/// Identifies the caller of a route.
pub(super) async fn authenticate(
    api: &ApiState,
    parts: &Parts,
    route: Asked,
) -> Result<Caller, Problem> {
    let credential = shown(api, &parts.headers)?;
    let Some(credential) = credential else {
        if api.access.has_users(&api.store).await? {
            return Err(missing());
        }
        let detail = "there are no users yet; open the setup link that the service printed at its \
                      start, or make one with `fleetcal user create`";
        return Err(unauthorised("setup_required", detail));
    };
    let mut caller = known(api, credential, route).await?;
    caller.actor.request = Some(http_request(parts));
    Ok(caller)
}

/// Identifies the account of a credential.
async fn known(api: &ApiState, credential: Credential, route: Asked) -> Result<Caller, Problem> {
    let now = api.clock.now();
    match credential {
        Credential::Session(hash) => {
            let found = api.store.session_of(hash).await?;
            let session = found
                .filter(|session| session.span.is_valid(now))
                .ok_or_else(|| unauthorised("session_ended", "the session has ended; sign in"))?;
            if session.span.is_to_be_noted(now) {
                api.store.note_use(credential);
            }
            Ok(Caller {
                actor: actor(session.user.name.as_str(), &session.user.grant, credential),
                grant: session.user.grant,
                credential,
                session: Some(session.span),
                route,
            })
        }
        Credential::Token(hash) => {
            let refused = |code, what: &str| unauthorised(code, &format!("the token {what}"));
            let found = api.store.token_of(hash).await?;
            let token = found.ok_or_else(|| refused("token_unknown", "is unknown"))?;
            match token.state(now) {
                TokenState::Valid => {}
                TokenState::Expired => return Err(refused("token_expired", "has expired")),
                TokenState::Revoked => return Err(refused("token_revoked", "was revoked")),
            }
            if token
                .used_ns
                .is_none_or(|used| now >= used.plus(limits::SESSION_USE_NOTED_EVERY))
            {
                api.store.note_use(credential);
            }
            Ok(Caller {
                actor: actor(token.name.as_str(), &token.grant, credential),
                grant: token.grant,
                credential,
                session: None,
                route,
            })
        }
    }
}

fn actor(name: &str, grant: &Grant, credential: Credential) -> Actor {
    Actor {
        name: name.to_owned(),
        authentication: match credential {
            Credential::Session(_) => Authentication::Session,
            Credential::Token(_) => Authentication::Token,
        },
        role: Some(grant.role()),
        request: None,
    }
}

/// Credential of a request: a token before a cookie. A malformed credential is refused, not
/// ignored.
fn shown(api: &ApiState, headers: &HeaderMap) -> Result<Option<Credential>, Problem> {
    if let Some(value) = headers.get(header::AUTHORIZATION) {
        let token = value
            .to_str()
            .ok()
            .and_then(|text| text.split_once(' '))
            .filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer"))
            .and_then(|(_, token)| TokenValue::parse(token.trim()));
        return match token {
            Some(token) => Ok(Some(Credential::Token(token.hash()))),
            None => Err(unauthorised(
                "token_unknown",
                "Authorization is not `Bearer cal_…`, a token of this service",
            )),
        };
    }
    match api.access.cookies.session(headers) {
        None => Ok(None),
        Some(Ok(session)) => Ok(Some(Credential::Session(session.hash()))),
        Some(Err(_)) => Err(unauthorised(
            "session_ended",
            "the session cookie is not one of this service; sign in",
        )),
    }
}

/// Record of a request for the audit: its id and client address.
pub(super) fn http_request(parts: &Parts) -> HttpRequest {
    let id = parts.extensions.get::<RequestId>();
    let id = id.and_then(|id| id.header_value().to_str().ok());
    let PeerAddress(peer) = parts.extensions.get().copied().unwrap_or(PeerAddress(None));
    HttpRequest {
        id: id.map(|text| text.chars().take(REQUEST_ID_CHARS_MAX).collect()),
        address: peer.map(|address| address.to_canonical().to_string()),
    }
}

fn missing() -> Problem {
    let detail = "sign in, or send a token as `Authorization: Bearer cal_…`";
    unauthorised("credential_missing", detail)
}

pub(super) fn unauthorised(code: &'static str, detail: &str) -> Problem {
    Problem::new(StatusCode::UNAUTHORIZED, code, detail)
}

/// Ends when the caller loses the permission for the route: the session ended, the token was
/// revoked, or the role no longer suffices. It queries the database periodically; while that fails,
/// the permission stays.
pub(crate) async fn permission_ended(api: ApiState, caller: Caller) {
    loop {
        tokio::time::sleep(limits::STREAM_ACCESS_CHECKED_EVERY).await;
        match still_permitted(&api, &caller).await {
            Ok(true) => {}
            Ok(false) => return,
            Err(error) => tracing::warn!(%error, "a listener's credential could not be checked"),
        }
    }
}

async fn still_permitted(api: &ApiState, caller: &Caller) -> Result<bool, StoreError> {
    let now = api.clock.now();
    Ok(match caller.credential {
        Credential::Session(hash) => {
            let session = api.store.session_of(hash).await?;
            session.is_some_and(|session| {
                session.span.is_valid(now) && caller.route.permits(&session.user.grant)
            })
        }
        Credential::Token(hash) => {
            let token = api.store.token_of(hash).await?;
            token.is_some_and(|token| {
                token.state(now) == TokenState::Valid && caller.route.permits(&token.grant)
            })
        }
    })
}
