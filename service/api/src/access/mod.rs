//! Access to routes: credentials, the table of permissions, and the routes of users, sessions and
//! tokens.

mod caller;
mod document;
mod guard;
mod session;
mod setup;
mod sign_in;
mod table;
mod tokens;
mod users;
mod writes;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use fleetcal_store::{Store, StoreError};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::ApiState;
use crate::cookie::CookiePolicy;
use crate::password::PasswordWork;
use fleetcal_http::{CallerWrites, PublicUrl, SignInLimits};

pub(super) use caller::{Caller, permission_ended};
pub(super) use guard::{authorise, cross_origin_refused};
#[cfg(test)]
pub(super) use table::TABLE;
pub(super) use table::access as of_route;
pub(super) use writes::count as count_writes;

/// Settings of the API's access.
#[derive(Debug, Clone, Default)]
pub struct AccessSetup {
    /// Public address of the service, if it differs from the address it listens on.
    pub public_url: Option<PublicUrl>,
}

/// State shared by the routes of access.
#[derive(Debug, Clone)]
pub(super) struct AccessState {
    cookies: CookiePolicy,
    passwords: PasswordWork,
    limits: Arc<SignInLimits>,
    writes: Arc<CallerWrites>,
    /// True if there is a user; it stays so, since the last administrator cannot be removed.
    has_users: Arc<AtomicBool>,
}

impl AccessState {
    /// State of a service that has just started.
    pub(super) fn new(setup: &AccessSetup) -> Self {
        let https = setup.public_url.as_ref().is_some_and(PublicUrl::is_https);
        Self {
            cookies: CookiePolicy::new(https),
            passwords: PasswordWork::default(),
            limits: Arc::default(),
            writes: Arc::default(),
            has_users: Arc::default(),
        }
    }

    async fn has_users(&self, store: &Store) -> Result<bool, StoreError> {
        if self.has_users.load(Ordering::Relaxed) {
            return Ok(true);
        }
        let has_users = store.has_users().await?;
        self.has_users.store(has_users, Ordering::Relaxed);
        Ok(has_users)
    }
}

/// Routes of access.
pub(super) fn routes() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new()
        .routes(routes!(
            session::sign_in,
            session::get_session,
            session::sign_out
        ))
        .routes(routes!(session::change_password))
        .routes(routes!(setup::set_up))
        .routes(routes!(tokens::list_tokens, tokens::create_token))
        .routes(routes!(tokens::revoke_token))
        .routes(routes!(users::list_users, users::create_user))
        .routes(routes!(
            users::get_user,
            users::edit_user,
            users::remove_user
        ))
}
