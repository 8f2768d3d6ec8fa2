//! Rules of users, sessions and tokens: reasons to refuse making, changing or removing one.
//!
//! The caller passes the records; the rules decide.

use fleetcal_model::{TokenId, UserId, Version, WallTime};

use thiserror::Error;

use super::grant::Grant;
use super::name::AccountName;
use super::role::Role;
use crate::limits;

/// Reason for which a user, session or token was not changed.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum AccountRefused {
    /// Unknown user.
    #[error("no user {0} is known")]
    UserUnknown(UserId),
    /// Unknown token.
    #[error("no token {0} is known")]
    TokenUnknown(TokenId),
    /// The session has ended.
    #[error("the session has ended")]
    SessionUnknown,
    /// Name of another user, or of another token that counts.
    #[error("the name {0} is taken")]
    NameTaken(AccountName),
    /// Version conflict: the user has changed since the caller read it.
    #[error("user {id} is at version {found}")]
    VersionConflict {
        /// User's id.
        id: UserId,
        /// Present version.
        found: Version,
    },
    /// Removal of the last administrator.
    #[error("this is the last administrator that can sign in; make another one first")]
    LastAdmin,
    /// Set-up when there is an administrator already.
    #[error("there are users already; sign in as one of them")]
    AlreadySetUp,
    /// Limit of users or tokens reached.
    #[error("there are {max} {what} already, which is the limit")]
    Full {
        /// Kind of record: users or tokens.
        what: &'static str,
        /// The limit.
        max: u32,
    },
}

/// True if an account with this grant counts as an administrator who can sign in.
pub fn counts_as_admin(grant: &Grant, disabled: bool) -> bool {
    grant.role() == Role::Admin && !disabled
}

/// Allows a new user beside `users` others; `is_taken` when one of them has the name, in upper or
/// lower case.
///
/// # Errors
/// [`AccountRefused::Full`] or [`AccountRefused::NameTaken`].
pub fn allow_new_user(
    users: u32,
    name: &AccountName,
    is_taken: bool,
) -> Result<(), AccountRefused> {
    allow_new("users", users, limits::USERS_MAX, name, is_taken)
}

/// Allows a new token beside `tokens` others, revoked ones included; `is_taken` when one that
/// counts has the name: two of one name could not be told apart in the audit.
///
/// # Errors
/// [`AccountRefused::Full`] or [`AccountRefused::NameTaken`].
pub fn allow_new_token(
    tokens: u32,
    name: &AccountName,
    is_taken: bool,
) -> Result<(), AccountRefused> {
    allow_new("tokens", tokens, limits::TOKENS_MAX, name, is_taken)
}

fn allow_new(
    what: &'static str,
    count: u32,
    max: u32,
    name: &AccountName,
    is_taken: bool,
) -> Result<(), AccountRefused> {
    if count >= max {
        return Err(AccountRefused::Full { what, max });
    }
    if is_taken {
        return Err(AccountRefused::NameTaken(name.clone()));
    }
    Ok(())
}

/// Allows the first administrator.
///
/// # Errors
/// [`AccountRefused::AlreadySetUp`] when there are `users`.
pub const fn allow_set_up(users: u32) -> Result<(), AccountRefused> {
    if users > 0 {
        return Err(AccountRefused::AlreadySetUp);
    }
    Ok(())
}

/// Allows a change of a user who counted as administrator or not, before and after it, while
/// `admins` of them can sign in.
///
/// # Errors
/// [`AccountRefused::LastAdmin`] when nobody could administrate any more.
pub const fn allow_change(
    was_admin: bool,
    stays_admin: bool,
    admins: u32,
) -> Result<(), AccountRefused> {
    if was_admin && !stays_admin && admins <= 1 {
        return Err(AccountRefused::LastAdmin);
    }
    Ok(())
}

/// Latest begin, and latest use, of sessions that have ended at `now`: one that began or was last
/// used at these times or before has ended.
pub fn ended_before(now: WallTime) -> (WallTime, WallTime) {
    (
        now.minus(limits::SESSION_MAX),
        now.minus(limits::SESSION_IDLE_MAX),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name() -> AccountName {
        AccountName::parse("anna").unwrap()
    }

    #[test]
    fn a_full_list_is_refused_before_a_taken_name() {
        assert_eq!(
            allow_new_user(limits::USERS_MAX - 1, &name(), false),
            Ok(())
        );
        let full = allow_new_user(limits::USERS_MAX, &name(), true).unwrap_err();
        let max = limits::USERS_MAX;
        assert_eq!(full, AccountRefused::Full { what: "users", max });
        let taken = allow_new_token(0, &name(), true).unwrap_err();
        assert_eq!(taken, AccountRefused::NameTaken(name()));
        let full = allow_new_token(limits::TOKENS_MAX, &name(), false).unwrap_err();
        assert_eq!(
            full.to_string(),
            "there are 10000 tokens already, which is the limit"
        );
    }

    #[test]
    fn only_an_empty_service_is_set_up() {
        assert_eq!(allow_set_up(0), Ok(()));
        assert_eq!(allow_set_up(1), Err(AccountRefused::AlreadySetUp));
    }

    #[test]
    fn the_last_administrator_stays_and_others_go() {
        assert_eq!(allow_change(true, false, 1), Err(AccountRefused::LastAdmin));
        assert_eq!(allow_change(true, false, 2), Ok(()));
        assert_eq!(allow_change(true, true, 1), Ok(()));
        assert_eq!(allow_change(false, false, 1), Ok(()));
    }

    #[test]
    fn who_is_disabled_does_not_count_as_administrator() {
        let admin = Grant::of_person(Role::Admin).unwrap();
        assert!(counts_as_admin(&admin, false));
        assert!(!counts_as_admin(&admin, true));
        let viewer = Grant::of_person(Role::Viewer).unwrap();
        assert!(!counts_as_admin(&viewer, false));
    }
}
