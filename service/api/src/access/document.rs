//! Documents of users, sessions and tokens.

use fleetcal_domain::access::{Authentication, Role, TokenState};
use fleetcal_model::{TokenId, UserId, Version, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_store::{TokenRecord, UserRecord};
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use super::caller::Caller;
use crate::page::page_limit;
use crate::problem::Problem;
use crate::time;

/// Caller that is signed in, or whose token it is.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Session)]
pub(super) struct SessionDocument {
    /// Name of the user or token.
    pub(super) name: String,
    /// Role of the caller.
    pub(super) role: Role,
    /// Kind of credential of the request.
    pub(super) credential: CredentialKind,
    /// End of the session unless it is used again.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub(super) ends: Option<Timestamp>,
}

/// Kind of credential.
#[derive(Debug, Clone, Copy, Serialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum CredentialKind {
    /// Session's cookie.
    Session,
    /// API token.
    Token,
}

impl SessionDocument {
    /// Document of a caller.
    pub(super) fn of(caller: Caller) -> Self {
        Self {
            role: caller.grant.role(),
            credential: match caller.actor.authentication {
                Authentication::Token => CredentialKind::Token,
                _ => CredentialKind::Session,
            },
            ends: caller.session.map(|span| time::of(span.ends())),
            name: caller.actor.name,
        }
    }
}

/// User who can sign in.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = User)]
pub(super) struct UserDocument {
    id: UserId,
    name: String,
    role: Role,
    /// True if signing in is refused.
    disabled: bool,
    /// Version, incremented with every change; the `ETag`.
    version: Version,
    #[schema(value_type = String, format = DateTime)]
    created: Timestamp,
    #[schema(value_type = String, format = DateTime)]
    updated: Timestamp,
    /// Time of the last sign-in.
    #[schema(value_type = Option<String>, format = DateTime)]
    signed_in: Option<Timestamp>,
}

impl UserDocument {
    /// Document of a user.
    pub(super) fn of(record: &UserRecord) -> Self {
        Self {
            id: record.id,
            name: record.name.to_string(),
            role: record.grant.role(),
            disabled: record.disabled,
            version: record.version,
            created: time::of(record.created_ns),
            updated: time::of(record.updated_ns),
            signed_in: record.signed_in_ns.map(time::of),
        }
    }
}

/// A page of users, oldest first.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct UserPage {
    pub(super) items: Vec<UserDocument>,
    /// Value of `cursor` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) next: Option<String>,
}

/// API token, without its value.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Token)]
pub(super) struct TokenDocument {
    id: TokenId,
    name: String,
    role: Role,
    /// Robot of a token of role `robot`.
    robot: Option<RobotId>,
    /// Validity of the token.
    state: TokenStateSchema,
    created_by: String,
    #[schema(value_type = String, format = DateTime)]
    created: Timestamp,
    /// End of its validity, if it has one.
    #[schema(value_type = Option<String>, format = DateTime)]
    expires: Option<Timestamp>,
    #[schema(value_type = Option<String>, format = DateTime)]
    revoked: Option<Timestamp>,
    /// Time of its last use, to the minute.
    #[schema(value_type = Option<String>, format = DateTime)]
    last_used: Option<Timestamp>,
    /// Value to send as `Authorization: Bearer …`, in the answer that creates the token alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) value: Option<String>,
}

/// Validity of a token.
#[derive(Debug, Clone, Copy, Serialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
#[schema(as = TokenState)]
enum TokenStateSchema {
    Valid,
    Expired,
    Revoked,
}

impl TokenDocument {
    /// Document of a token at `now`.
    pub(super) fn of(record: &TokenRecord, now: WallTime) -> Self {
        Self {
            id: record.id,
            name: record.name.to_string(),
            role: record.grant.role(),
            robot: record.grant.robot().cloned(),
            state: match record.state(now) {
                TokenState::Valid => TokenStateSchema::Valid,
                TokenState::Expired => TokenStateSchema::Expired,
                TokenState::Revoked => TokenStateSchema::Revoked,
            },
            created_by: record.created_by.clone(),
            created: time::of(record.span.created_ns),
            expires: record.span.expires_ns.map(time::of),
            revoked: record.span.revoked_ns.map(time::of),
            last_used: record.used_ns.map(time::of),
            value: None,
        }
    }
}

/// A page of tokens, oldest first.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct TokenPage {
    pub(super) items: Vec<TokenDocument>,
    /// Value of `cursor` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) next: Option<String>,
}

/// Page of a list.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct PageParameters {
    /// Entries of a page, 1 to 1000.
    #[param(value_type = Option<u32>)]
    limit: Option<String>,
    /// Value of `next` of the previous page.
    cursor: Option<String>,
}

impl PageParameters {
    /// Number that the page begins after, and its largest length.
    pub(super) fn checked(&self) -> Result<(i64, u32), Problem> {
        let limit = page_limit(self.limit.as_deref())?;
        let after = match self.cursor.as_deref() {
            None => 0,
            Some(cursor) => cursor
                .parse()
                .map_err(|_| Problem::refused("cursor", cursor, "`next` of the page before"))?,
        };
        Ok((after, limit))
    }
}
