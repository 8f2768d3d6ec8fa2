//! Routes of `/users`: people who sign in.

use axum::Json;
use axum::extract::{FromRequestParts, Path, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use fleetcal_domain::access::{AccountName, AccountRefused, Grant, GrantRefused, Role};
use fleetcal_model::UserId;
use fleetcal_operations::accounts::{UserChange, UserEdit, change_user};
use fleetcal_store::{StoreError, UserRecord};
use serde::Deserialize;
use sha2::{Digest, Sha256};

use super::caller::Caller;
use super::document::{PageParameters, UserDocument, UserPage};
use crate::ApiState;
use crate::etag::{expected, versioned_json};
use crate::extract::{Body, NoParameters, Parameters, idempotency_key};
use crate::page::{cut, with_next};
use crate::problem::Problem;

/// Number in a path.
#[derive(Debug)]
pub(super) struct NumberPath(pub(super) i64);

impl<S: Send + Sync> FromRequestParts<S> for NumberPath {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let Path(id) = Path::<String>::from_request_parts(parts, state)
            .await
            .map_err(|rejection| Problem::refused("id", &rejection.body_text(), "a number"))?;
        id.parse()
            .map(Self)
            .map_err(|_| Problem::refused("id", &id, "a number"))
    }
}

/// Lists the users, oldest first.
#[utoipa::path(
    get,
    path = "/users",
    tag = "access",
    params(PageParameters),
    responses(
        (status = OK, description = "A page of users", body = UserPage),
    )
)]
pub(super) async fn list_users(
    State(api): State<ApiState>,
    Parameters(page): Parameters<PageParameters>,
) -> Result<Json<UserPage>, Problem> {
    let (after, limit) = page.checked()?;
    let mut records = api.store.users(after, with_next(limit)).await?;
    let next = cut(&mut records, limit, |last| last.id.to_string());
    let items = records.iter().map(UserDocument::of).collect();
    Ok(Json(UserPage { items, next }))
}

/// Returns one user.
///
/// The `ETag` is the version.
#[utoipa::path(
    get,
    path = "/users/{id}",
    tag = "access",
    params(("id" = i64, Path, description = "The user's number.")),
    responses(
        (status = OK, description = "The user", body = UserDocument,
            headers(("ETag" = String, description = "Version of the user."))),
        (status = NOT_FOUND, description = "The user is unknown"),
    )
)]
pub(super) async fn get_user(
    State(api): State<ApiState>,
    NumberPath(id): NumberPath,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Response, Problem> {
    let user = api.store.user(UserId(id)).await?;
    let user = user.ok_or(StoreError::from(AccountRefused::UserUnknown(UserId(id))))?;
    Ok(answer(StatusCode::OK, &user))
}

/// User to be created.
#[derive(Deserialize, utoipa::ToSchema)]
#[schema(as = NewUser)]
#[serde(deny_unknown_fields)]
pub(super) struct NewUserDocument {
    #[schema(max_length = 64)]
    name: String,
    role: Role,
    /// Password, 12 to 128 characters.
    #[schema(format = Password, min_length = 12, max_length = 128)]
    password: String,
}

/// Creates a user.
#[utoipa::path(
    post,
    path = "/users",
    tag = "access",
    params(("Idempotency-Key" = Option<String>, Header,
        description = "The same for each repetition of a request, at most 128 characters.")),
    request_body = NewUserDocument,
    responses(
        (status = CREATED, description = "The new user", body = UserDocument,
            headers(("ETag" = String, description = "Version of the user."))),
        (status = CONFLICT, description = "The name is taken, or the limit of users is reached"),
    )
)]
pub(super) async fn create_user(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    caller: Caller,
    headers: HeaderMap,
    Body { value: body, .. }: Body<NewUserDocument>,
) -> Result<Response, Problem> {
    let name = checked_name(&body.name)?;
    let grant = Grant::of_person(body.role).map_err(|error| grant_refused(&error))?;
    // Not of the body: from its hash the password could be guessed.
    let asked = format!("{name}\n{}", body.role.as_str());
    let key = idempotency_key(&headers, Sha256::digest(asked).into())?;
    let change = UserChange::Create {
        name,
        grant,
        password: api.access.passwords.hash(&body.password).await?,
        key,
    };
    let written = change_user(&api.store, caller.actor, change).await?;
    Ok(answer(StatusCode::CREATED, &written.record))
}

/// Changes of a user.
#[derive(Deserialize, utoipa::ToSchema)]
#[schema(as = UserEdit)]
#[serde(deny_unknown_fields)]
pub(super) struct UserEditDocument {
    #[serde(default)]
    role: Option<Role>,
    /// True to refuse signing in, which ends the user's sessions.
    #[serde(default)]
    disabled: Option<bool>,
    /// New password, 12 to 128 characters; it ends the user's sessions.
    #[serde(default)]
    #[schema(format = Password, min_length = 12, max_length = 128)]
    password: Option<String>,
}

/// Changes a user's role or password, or the permission to sign in.
#[utoipa::path(
    patch,
    path = "/users/{id}",
    tag = "access",
    params(
        ("id" = i64, Path, description = "The user's number."),
        ("If-Match" = String, Header, description = "The ETag of GET."),
    ),
    request_body = UserEditDocument,
    responses(
        (status = OK, description = "The changed user", body = UserDocument,
            headers(("ETag" = String, description = "Version of the user."))),
        (status = NOT_FOUND, description = "The user is unknown"),
        (status = CONFLICT, description = "The user is the last administrator"),
    )
)]
pub(super) async fn edit_user(
    State(api): State<ApiState>,
    NumberPath(id): NumberPath,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    caller: Caller,
    headers: HeaderMap,
    Body { value: body, .. }: Body<UserEditDocument>,
) -> Result<Response, Problem> {
    let expected = expected(&headers)?;
    if body.role.is_none() && body.disabled.is_none() && body.password.is_none() {
        let detail = "the body: give at least one of role, disabled, password";
        let status = StatusCode::UNPROCESSABLE_ENTITY;
        return Err(Problem::new(status, "body_refused", detail));
    }
    let grant = body
        .role
        .map(|role| Grant::of_person(role).map_err(|error| grant_refused(&error)))
        .transpose()?;
    let password = match &body.password {
        Some(password) => Some(api.access.passwords.hash(password).await?),
        None => None,
    };
    let change = UserChange::Edit {
        id: UserId(id),
        expected,
        edit: UserEdit {
            grant,
            password,
            disabled: body.disabled,
        },
        keep: None,
    };
    let written = change_user(&api.store, caller.actor, change).await?;
    Ok(answer(StatusCode::OK, &written.record))
}

/// Removes a user.
///
/// The audit keeps the name.
#[utoipa::path(
    delete,
    path = "/users/{id}",
    tag = "access",
    params(
        ("id" = i64, Path, description = "The user's number."),
        ("If-Match" = String, Header, description = "The ETag of GET."),
    ),
    responses(
        (status = NO_CONTENT, description = "The user is removed"),
        (status = NOT_FOUND, description = "The user is unknown"),
        (status = CONFLICT, description = "The user is the last administrator"),
    )
)]
pub(super) async fn remove_user(
    State(api): State<ApiState>,
    NumberPath(id): NumberPath,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    caller: Caller,
    headers: HeaderMap,
) -> Result<StatusCode, Problem> {
    let expected = expected(&headers)?;
    let change = UserChange::Remove {
        id: UserId(id),
        expected,
    };
    change_user(&api.store, caller.actor, change).await?;
    Ok(StatusCode::NO_CONTENT)
}

fn answer(status: StatusCode, user: &UserRecord) -> Response {
    versioned_json(status, user.version, UserDocument::of(user))
}

/// Parses a name in a body.
pub(super) fn checked_name(name: &str) -> Result<AccountName, Problem> {
    AccountName::parse(name).map_err(|refused| {
        let status = StatusCode::UNPROCESSABLE_ENTITY;
        Problem::new(status, "body_refused", refused.to_string()).of_field("name")
    })
}

/// Problem of a role that requires or excludes the given robot.
pub(super) fn grant_refused(refused: &GrantRefused) -> Problem {
    let field = match refused {
        GrantRefused::NoPerson => "role",
        GrantRefused::RobotMissing | GrantRefused::RobotNotAccepted(_) => "robot",
    };
    let status = StatusCode::UNPROCESSABLE_ENTITY;
    Problem::new(status, "body_refused", refused.to_string()).of_field(field)
}
