//! Who may do what: roles, credentials and actors. Pure: randomness and time are arguments.

mod actor;
mod grant;
mod name;
mod password;
mod permission;
mod role;
mod secret;
mod session;
mod setup;
mod throttle;
mod token;

pub use actor::{Actor, Authentication};
pub use grant::{Grant, GrantRefused};
pub use name::{AccountName, NameRefused};
pub use password::{HashFailed, Password, PasswordHash, PasswordRefused};
pub use permission::Access;
pub use role::Role;
pub use secret::{Random, SecretHash};
pub use session::{SessionSpan, SessionValue};
pub use setup::SetupCode;
pub use throttle::Throttle;
pub use token::{TokenSpan, TokenState, TokenValue};
