//! Routes of `/tokens`: API tokens of tools and robots.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use fleetcal_domain::access::{Grant, Role, TokenValue};
use fleetcal_domain::limits;
use fleetcal_model::{TokenId, WallTime};
use fleetcal_operations::accounts::{TokenChange, change_token};
use fleetcal_operations::entropy;
use fleetcal_proto::RobotId;
use jiff::Timestamp;
use serde::Deserialize;

use super::caller::Caller;
use super::document::{PageParameters, TokenDocument, TokenPage};
use super::users::{NumberPath, checked_name, grant_refused};
use crate::ApiState;
use crate::extract::{Body, NoParameters, Parameters, idempotency_key};
use crate::page::{cut, with_next};
use crate::password::failed;
use crate::problem::Problem;
use crate::time;

/// Lists the tokens, oldest first, revoked ones included.
#[utoipa::path(
    get,
    path = "/tokens",
    tag = "access",
    params(PageParameters),
    responses(
        (status = OK, description = "A page of tokens, without their values", body = TokenPage),
    )
)]
pub(super) async fn list_tokens(
    State(api): State<ApiState>,
    Parameters(page): Parameters<PageParameters>,
) -> Result<Json<TokenPage>, Problem> {
    let (after, limit) = page.checked()?;
    let mut records = api.store.tokens(after, with_next(limit)).await?;
    let next = cut(&mut records, limit, |last| last.id.to_string());
    let now = api.clock.now();
    let document = |token| TokenDocument::of(token, now);
    let items = records.iter().map(document).collect();
    Ok(Json(TokenPage { items, next }))
}

/// Token to be created.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(as = NewToken)]
#[serde(deny_unknown_fields)]
pub(super) struct NewTokenDocument {
    /// Name of its caller in the audit.
    #[schema(max_length = 64)]
    name: String,
    role: Role,
    /// Robot of a token of role `robot`.
    #[serde(default)]
    robot: Option<RobotId>,
    /// End of its validity; unlimited unless given.
    #[serde(default)]
    #[schema(value_type = Option<String>, format = DateTime)]
    expires: Option<Timestamp>,
}

/// Creates a token.
///
/// Its `value` is in this answer and never shown again: a request that is repeated with its
/// `Idempotency-Key` is answered without it.
#[utoipa::path(
    post,
    path = "/tokens",
    tag = "access",
    params(("Idempotency-Key" = Option<String>, Header,
        description = "The same for each repetition of a request, at most 128 characters.")),
    request_body = NewTokenDocument,
    responses(
        (status = CREATED, description = "The new token, with its value", body = TokenDocument),
        (status = CONFLICT, description = "The name is taken, or the limit of tokens is reached"),
    )
)]
pub(super) async fn create_token(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    caller: Caller,
    headers: HeaderMap,
    Body {
        value: body,
        sha256,
    }: Body<NewTokenDocument>,
) -> Result<Response, Problem> {
    let key = idempotency_key(&headers, sha256)?;
    let now = api.clock.now();
    let random = entropy::secret().map_err(|error| failed(&error))?;
    let value = TokenValue::new(&random);
    let change = TokenChange::Create {
        name: checked_name(&body.name)?,
        grant: Grant::of_token(body.role, body.robot).map_err(|error| grant_refused(&error))?,
        hash: value.hash(),
        expires_ns: body.expires.map(|expires| end(expires, now)).transpose()?,
        key,
    };
    let written = change_token(&api.store, caller.actor, change).await?;
    let mut document = TokenDocument::of(&written.record, now);
    if !written.repeated {
        document.value = Some(value.reveal().to_owned());
    }
    let unkept = [(header::CACHE_CONTROL, HeaderValue::from_static("no-store"))];
    Ok((StatusCode::CREATED, unkept, Json(document)).into_response())
}

/// Checked end of a token that is created at `now`.
fn end(expires: Timestamp, now: WallTime) -> Result<WallTime, Problem> {
    time::wall(expires)
        .filter(|end| *end > now && *end <= now.plus(limits::TOKEN_EXPIRES_MAX))
        .ok_or_else(|| {
            let accepted = "a time to come, within ten years";
            Problem::refused("expires", &expires.to_string(), accepted)
        })
}

/// Revokes a token: it is invalid from now on, and stays in the list.
#[utoipa::path(
    delete,
    path = "/tokens/{id}",
    tag = "access",
    params(("id" = i64, Path, description = "The token's number.")),
    responses(
        (status = NO_CONTENT, description = "The token is revoked"),
        (status = NOT_FOUND, description = "The token is unknown"),
    )
)]
pub(super) async fn revoke_token(
    State(api): State<ApiState>,
    NumberPath(id): NumberPath,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    caller: Caller,
) -> Result<StatusCode, Problem> {
    change_token(
        &api.store,
        caller.actor,
        TokenChange::Revoke { id: TokenId(id) },
    )
    .await?;
    Ok(StatusCode::NO_CONTENT)
}
