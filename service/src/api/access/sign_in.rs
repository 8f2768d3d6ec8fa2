//! Whether a name and a password belong together, and how often one may ask.

use std::net::IpAddr;
use std::sync::{Mutex, MutexGuard, PoisonError};
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
    name_at_address: Mutex<Throttle>,
    name_anywhere: Mutex<Throttle>,
    address: Mutex<Throttle>,
}

impl Default for SignInLimits {
    fn default() -> Self {
        let throttle =
            |every, burst| Mutex::new(Throttle::new(every, burst, limits::SIGN_IN_KEYS_MAX));
        Self {
            name_at_address: throttle(limits::SIGN_IN_NAME_EVERY, limits::SIGN_IN_NAME_BURST),
            name_anywhere: throttle(
                limits::SIGN_IN_EVERYWHERE_EVERY,
                limits::SIGN_IN_EVERYWHERE_BURST,
            ),
            address: throttle(limits::SIGN_IN_ADDRESS_EVERY, limits::SIGN_IN_ADDRESS_BURST),
        }
    }
}

impl SignInLimits {
    /// Counts a try from an address.
    pub(super) fn count_address(&self, peer: PeerAddress, now: Duration) -> Result<(), Problem> {
        take(&self.address, &peer.key(), now)
    }

    /// Counts a try under a name. What one address tries too often does not count for the others.
    fn count_name(&self, peer: PeerAddress, name: &str, now: Duration) -> Result<(), Problem> {
        take(&self.name_at_address, &here(peer, name), now)?;
        take(&self.name_anywhere, name, now)
    }

    /// Forgets the tries under a name, since the last one was right.
    fn forget_name(&self, peer: PeerAddress, name: &str) {
        open(&self.name_at_address).forget(&here(peer, name));
        open(&self.name_anywhere).forget(name);
    }
}

/// A name at an address: no name has a line break.
fn here(peer: PeerAddress, name: &str) -> String {
    format!("{}\n{name}", peer.key())
}

fn open(throttle: &Mutex<Throttle>) -> MutexGuard<'_, Throttle> {
    throttle.lock().unwrap_or_else(PoisonError::into_inner)
}

fn take(throttle: &Mutex<Throttle>, key: &str, now: Duration) -> Result<(), Problem> {
    open(throttle).take(key, now).map_err(too_many)
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
    limits.count_name(peer, &key, now)?;
    let user = api.store.user_named(name).await?;
    let hash = user
        .as_ref()
        .map_or_else(PasswordHash::of_nobody, |user| user.password.clone());
    let right = api.access.passwords.verify(hash, password).await?;
    let Some(user) = user.filter(|user| right && !user.disabled) else {
        tracing::warn!(peer = %peer.key(), "a sign-in was refused");
        return Err(unauthorised("sign_in_refused", "name or password is wrong"));
    };
    limits.forget_name(peer, &key);
    Ok(user)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_tries_too_often_keeps_nobody_else_out() {
        let limits = SignInLimits::default();
        let at = |last: u8| PeerAddress(Some(IpAddr::from([10, 0, 0, last])));
        let now = Duration::from_secs(1);
        let tried = (0..1_000).filter(|_| limits.count_name(at(1), "ana", now).is_ok());
        assert_eq!(tried.count(), limits::SIGN_IN_NAME_BURST as usize);
        assert!(limits.count_name(at(2), "ana", now).is_ok());
        // Many addresses together have a limit as well.
        let tried = (3..=255).filter(|last| limits.count_name(at(*last), "ana", now).is_ok());
        let others = limits::SIGN_IN_EVERYWHERE_BURST - limits::SIGN_IN_NAME_BURST - 1;
        assert_eq!(tried.count(), others as usize);
    }
}
