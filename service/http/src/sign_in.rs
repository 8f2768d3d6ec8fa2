//! Limit of attempts to sign in.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use fleetcal_domain::limits;

use crate::{Familiar, PeerAddress, Throttle};

/// Sender of a password, known or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Whose {
    /// A sender whose address has signed in under the name, or who is signed in.
    Known,
    /// Any other sender.
    Stranger,
}

/// Limits on attempts to sign in.
#[derive(Debug)]
pub struct SignInLimits {
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
    /// Counts an attempt from an address.
    ///
    /// # Errors
    /// The time to wait if there were too many.
    pub fn count_address(&self, peer: PeerAddress, now: Duration) -> Result<(), Duration> {
        take(&self.address, &peer.key(), now)
    }

    /// Counts an attempt under a name. The excess attempts of one address do not count for the
    /// others, and other addresses' attempts do not count for one that has signed in under the
    /// name.
    ///
    /// # Errors
    /// The time to wait if there were too many.
    pub fn count_name(
        &self,
        peer: PeerAddress,
        name: &str,
        now: Duration,
    ) -> Result<Whose, Duration> {
        let pair = peer.with_name(name);
        take(&self.name_at_address, &pair, now)?;
        if open(&self.familiar).knows(&pair) {
            return Ok(Whose::Known);
        }
        take(&self.name_anywhere, name, now)?;
        Ok(Whose::Stranger)
    }

    /// True if an address has signed in under a name.
    pub fn knows(&self, peer: PeerAddress, name: &str) -> bool {
        open(&self.familiar).knows(&peer.with_name(name))
    }

    /// Records an address that has signed in under a name at another instance.
    pub fn note_known(&self, peer: PeerAddress, name: &str) {
        open(&self.familiar).note(peer.with_name(name));
    }

    /// Forgets the attempts under a name after a correct one, and records its address.
    pub fn note_right(&self, peer: PeerAddress, name: &str) {
        let pair = peer.with_name(name);
        open(&self.name_at_address).forget(&pair);
        open(&self.name_anywhere).forget(name);
        open(&self.familiar).note(pair);
    }
}

fn open<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

fn take(throttle: &Mutex<Throttle>, key: &str, now: Duration) -> Result<(), Duration> {
    open(throttle).take(key, now)
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
            let through = (0..250).filter(|last| counted(*last).is_ok()).count();
            assert!(through <= limits::SIGN_IN_EVERYWHERE_BURST as usize);
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
