//! Whether a name and a password belong together, and how often one may ask.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::http::StatusCode;
use fleetcal_domain::access::PasswordHash;
use fleetcal_domain::limits;
use fleetcal_http::{Familiar, PeerAddress, Throttle};
use fleetcal_store::UserRecord;

use super::caller::unauthorised;
use super::password::Whose;
use crate::ApiState;
use crate::problem::Problem;

/// How often somebody may try to sign in.
#[derive(Debug)]
pub(super) struct SignInLimits {
    name_at_address: Mutex<Throttle>,
    name_anywhere: Mutex<Throttle>,
    address: Mutex<Throttle>,
    familiar: Mutex<Familiar>,
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
            familiar: Mutex::new(Familiar::new(limits::SIGN_IN_KNOWN_MAX)),
        }
    }
}

impl SignInLimits {
    /// Counts a try from an address.
    pub(super) fn count_address(&self, peer: PeerAddress, now: Duration) -> Result<(), Problem> {
        take(&self.address, &peer.key(), now)
    }

    /// Counts a try under a name. What one address tries too often does not count for the others,
    /// and what others try does not count for an address that has signed in under the name.
    fn count_name(&self, peer: PeerAddress, name: &str, now: Duration) -> Result<Whose, Problem> {
        let pair = here(peer, name);
        take(&self.name_at_address, &pair, now)?;
        if open(&self.familiar).knows(&pair) {
            return Ok(Whose::Known);
        }
        take(&self.name_anywhere, name, now)?;
        Ok(Whose::Stranger)
    }

    /// Forgets the tries under a name, since the last one was right, and remembers its address.
    fn note_right(&self, peer: PeerAddress, name: &str) {
        let pair = here(peer, name);
        open(&self.name_at_address).forget(&pair);
        open(&self.name_anywhere).forget(name);
        open(&self.familiar).note(pair);
    }
}

/// A name at an address: no name has a line break.
fn here(peer: PeerAddress, name: &str) -> String {
    format!("{}\n{name}", peer.key())
}

fn open<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
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
    let whose = limits.count_name(peer, &key, now)?;
    let user = api.store.user_named(name).await?;
    let hash = user
        .as_ref()
        .map_or_else(PasswordHash::of_nobody, |user| user.password.clone());
    let right = api.access.passwords.verify(whose, hash, password).await?;
    let Some(user) = user.filter(|user| right && !user.disabled) else {
        tracing::warn!(peer = %peer.key(), "a sign-in was refused");
        return Err(unauthorised("sign_in_refused", "name or password is wrong"));
    };
    limits.note_right(peer, &key);
    Ok(user)
}

#[cfg(test)]
mod tests {
    use std::net::IpAddr;

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

    #[test]
    fn a_flood_keeps_nobody_out_who_has_signed_in_from_the_same_address() {
        let limits = SignInLimits::default();
        let now = Duration::from_secs(1);
        let at = |last: u8| PeerAddress(Some(IpAddr::from([10, 0, 0, last])));
        let counted = |last: u8| limits.count_name(at(last), "ana", now);
        assert_eq!(counted(250), Ok(Whose::Stranger));
        limits.note_right(at(250), "ana");
        for _ in 0..10 {
            for last in 0..250 {
                drop(counted(last));
            }
        }
        assert!(counted(251).is_err(), "a stranger waits");
        for _ in 0..20 {
            assert_eq!(counted(250), Ok(Whose::Known));
            limits.note_right(at(250), "ana");
        }
        // Wrong passwords from there have their own limit.
        let tried = (0..100).filter(|_| counted(250).is_ok());
        assert_eq!(tried.count(), limits::SIGN_IN_NAME_BURST as usize);
    }
}
