//! Whether a name and a password belong together, and how often one may ask.

use std::net::IpAddr;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use axum::extract::FromRequestParts;
use axum::http::StatusCode;
use axum::http::request::Parts;

use super::caller::unauthorised;
use crate::access::{PasswordHash, Throttle};
use crate::api::ApiState;
use crate::api::problem::Problem;
use crate::limits;
use crate::store::UserRecord;

/// The address that a connection comes from; that of the proxy where there is one.
#[derive(Debug, Clone, Copy)]
pub(in crate::api) struct PeerAddress(pub(in crate::api) Option<IpAddr>);

impl<S: Send + Sync> FromRequestParts<S> for PeerAddress {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Problem> {
        Ok(parts.extensions.get().copied().unwrap_or(Self(None)))
    }
}

impl PeerAddress {
    /// What tries are counted under. A network of IPv6 is one site's, which has many addresses.
    fn key(self) -> String {
        match self.0 {
            None => "unknown".to_owned(),
            Some(IpAddr::V4(address)) => address.to_string(),
            Some(IpAddr::V6(address)) => {
                let [a, b, c, d, ..] = address.segments();
                format!("{a:x}:{b:x}:{c:x}:{d:x}::/64")
            }
        }
    }
}

/// How often somebody may try to sign in.
#[derive(Debug)]
pub(super) struct SignInLimits {
    by_name: Mutex<Throttle>,
    by_address: Mutex<Throttle>,
}

impl Default for SignInLimits {
    fn default() -> Self {
        let throttle =
            |every, burst| Mutex::new(Throttle::new(every, burst, limits::SIGN_IN_KEYS_MAX));
        Self {
            by_name: throttle(limits::SIGN_IN_NAME_EVERY, limits::SIGN_IN_NAME_BURST),
            by_address: throttle(limits::SIGN_IN_ADDRESS_EVERY, limits::SIGN_IN_ADDRESS_BURST),
        }
    }
}

impl SignInLimits {
    /// Counts a try from an address.
    pub(super) fn count_address(&self, peer: PeerAddress, now: Duration) -> Result<(), Problem> {
        take(&self.by_address, &peer.key(), now)
    }
}

fn take(throttle: &Mutex<Throttle>, key: &str, now: Duration) -> Result<(), Problem> {
    let mut throttle = throttle.lock().unwrap_or_else(PoisonError::into_inner);
    throttle.take(key, now).map_err(too_many)
}

fn too_many(wait: Duration) -> Problem {
    let seconds = u32::try_from(wait.as_secs())
        .unwrap_or(u32::MAX)
        .saturating_add(1);
    let detail = format!("too many tries; try again in {seconds} s");
    Problem::new(StatusCode::TOO_MANY_REQUESTS, "too_many_tries", detail).retry_after(seconds)
}

/// The user of this name and password. An unknown name takes as long as a wrong password, and the
/// answer is the same.
pub(super) async fn verified(
    api: &ApiState,
    peer: PeerAddress,
    name: &str,
    password: String,
) -> Result<UserRecord, Problem> {
    let limits = &api.access.limits;
    let now = api.clock.elapsed();
    let key: String = name
        .chars()
        .take(limits::ACCOUNT_NAME_CHARS_MAX)
        .collect::<String>()
        .to_lowercase();
    limits.count_address(peer, now)?;
    take(&limits.by_name, &key, now)?;
    let user = api.store.user_named(name).await?;
    let hash = user
        .as_ref()
        .map_or_else(PasswordHash::of_nobody, |user| user.password.clone());
    let right = api.access.passwords.verify(hash, password).await?;
    let Some(user) = user.filter(|user| right && !user.disabled) else {
        tracing::warn!(peer = %peer.key(), "a sign-in was refused");
        return Err(unauthorised("sign_in_refused", "name or password is wrong"));
    };
    let mut by_name = limits
        .by_name
        .lock()
        .unwrap_or_else(PoisonError::into_inner);
    by_name.forget(&key);
    Ok(user)
}
