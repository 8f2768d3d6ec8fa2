//! Changes of users, sessions and API tokens, by the rules of [`fleetcal_domain::access`]: every
//! change with its audit row in one transaction.

mod setup;
#[cfg(test)]
mod tests;
mod token;
mod user;

use fleetcal_domain::access::Actor;
use fleetcal_store::{Store, StoreError, TokenRecord, UserRecord, Written};

pub use setup::KeepSetupCode;
pub use token::{ChangeToken, TokenChange};
pub use user::{ChangeUser, UserChange, UserEdit};

use crate::Boxed;

/// Changes a user, or a user's sessions.
///
/// # Errors
/// [`StoreError::Account`] if it is refused, [`StoreError::KeyReused`]; otherwise the database's
/// failure.
pub fn change_user(
    store: &Store,
    actor: Actor,
    change: UserChange,
) -> Boxed<Result<Written<UserRecord>, StoreError>> {
    let store = store.clone();
    let now = store.now();
    let job = ChangeUser { actor, now, change };
    Box::pin(async move { store.transact(job).await })
}

/// Changes a token.
///
/// # Errors
/// [`StoreError::Account`] if it is refused, [`StoreError::KeyReused`]; otherwise the database's
/// failure.
pub fn change_token(
    store: &Store,
    actor: Actor,
    change: TokenChange,
) -> Boxed<Result<Written<TokenRecord>, StoreError>> {
    let store = store.clone();
    let now = store.now();
    let job = ChangeToken { actor, now, change };
    Box::pin(async move { store.transact(job).await })
}
