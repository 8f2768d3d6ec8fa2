//! Failures of PostgreSQL, and what each means for transaction and connection.

use std::fmt;

use sqlx::Error;
use thiserror::Error;

/// Fate of a transaction after a statement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Fate {
    /// The transaction is intact.
    Well,
    /// The transaction can only be undone.
    Aborted,
    /// The transaction can only be undone, and may succeed on a retry: it conflicted with another
    /// one.
    Conflict,
    /// Its state is unknown, and the connection is no longer usable.
    Lost,
}

/// SQLSTATEs of PostgreSQL, appendix A of its manual.
pub(crate) mod state {
    /// A transaction could not be serialized with others.
    pub const SERIALIZATION_FAILURE: &str = "40001";
    /// Two transactions waited for each other.
    pub const DEADLOCK: &str = "40P01";
    /// A lock was not available within `lock_timeout`.
    pub const LOCK_NOT_AVAILABLE: &str = "55P03";
    /// A row with the same key exists.
    pub const UNIQUE_VIOLATION: &str = "23505";
    /// The server is a standby.
    pub const READ_ONLY: &str = "25006";
    /// The role lacks the privilege.
    pub const INSUFFICIENT_PRIVILEGE: &str = "42501";
    /// The user's password is wrong, or the user may not sign in.
    pub const REFUSED: [&str; 2] = ["28P01", "28000"];
    /// Class of states with which a server ends a connection.
    pub const OPERATOR_INTERVENTION: &str = "57P";
    /// Class of states about the connection itself.
    pub const CONNECTION: &str = "08";
}

impl Fate {
    /// Returns the fate after an error.
    pub(crate) fn after(error: &Error) -> Self {
        let Error::Database(told) = error else {
            return match error {
                // The answer came whole, and was not what was expected of it.
                Error::ColumnDecode { .. } | Error::Decode(_) | Error::RowNotFound => Self::Aborted,
                _ => Self::Lost,
            };
        };
        match told.code().as_deref() {
            Some(
                state::SERIALIZATION_FAILURE
                | state::DEADLOCK
                | state::LOCK_NOT_AVAILABLE
                // Serializable transactions that take the next free number meet in it.
                | state::UNIQUE_VIOLATION,
            ) => Self::Conflict,
            Some(state::READ_ONLY) | None => Self::Lost,
            Some(code)
                if code.starts_with(state::OPERATOR_INTERVENTION)
                    || code.starts_with(state::CONNECTION) =>
            {
                Self::Lost
            }
            Some(_) => Self::Aborted,
        }
    }
}

/// Error of a statement that exceeded its time limit.
#[derive(Debug, Error)]
#[error("the database did not answer within {seconds} s")]
pub(crate) struct TimedOut {
    pub(crate) seconds: f32,
}

/// Reason for which a server cannot be used, as one clause behind the server's name.
pub(crate) struct Unusable<'e>(pub(crate) &'e Error);

impl fmt::Display for Unusable<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Error::Database(told) => {
                let code = told.code();
                let refused = code
                    .as_deref()
                    .is_some_and(|code| state::REFUSED.contains(&code));
                let verb = if refused {
                    "refuses the user"
                } else {
                    "refuses"
                };
                write!(f, "{verb}: {}", told.message())
            }
            Error::Io(error) => write!(f, "cannot be reached: {error}"),
            Error::Tls(error) => write!(f, "gives no trusted TLS: {error}"),
            error => write!(f, "cannot be used: {error}"),
        }
    }
}
