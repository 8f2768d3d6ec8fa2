//! Access: roles, credentials and actors. Pure: randomness and time are arguments.

mod account;
mod actor;
mod grant;
mod name;
mod password;
mod permission;
mod role;
mod secret;
mod session;
mod setup;
mod token;

pub use account::{
    AccountRefused, allow_change, allow_new_token, allow_new_user, allow_set_up, counts_as_admin,
    ended_before,
};
pub use actor::{Actor, Authentication, FORWARDED_BY, HttpRequest};
pub use grant::{Grant, GrantRefused};
pub use name::{AccountName, NameRefused};
pub use password::{HashFailed, Password, PasswordHash, PasswordRefused};
pub use permission::Access;
pub use role::Role;
pub use secret::{Random, SecretHash};
pub use session::{SessionSpan, SessionValue};
pub use setup::SetupCode;
pub use token::{TokenSpan, TokenState, TokenValue};
