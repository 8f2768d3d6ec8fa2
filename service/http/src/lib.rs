//! The accept loop of HTTP and its limits: which connections and requests are served, how long a
//! peer may take, and from which address a request comes. It knows no route.

mod acceptor;
mod caller_writes;
mod client_address;
pub mod compressed;
mod connections;
pub mod csv;
mod exports;
mod familiar;
pub mod host;
mod instances;
mod progress;
mod public_url;
mod refusal;
mod security_contact;
mod server;
mod shares;
mod sign_in;
mod throttle;
mod trusted_proxies;
mod written;

pub use acceptor::listen;
pub use caller_writes::{CallerWrites, WritesExceeded};
pub use client_address::PeerAddress;
pub use connections::Connections;
pub use exports::{ExportPlace, ExportRefused, Exports, until};
pub use familiar::Familiar;
pub use instances::{InstanceAddresses, is_forwarded};
pub use progress::WritePatience;
pub use public_url::PublicUrl;
pub use refusal::Turned;
pub use security_contact::{SecurityContact, SecurityContacts};
pub use server::{LocalAddress, Served, Serving, serve};
pub use shares::{Share, Shares};
pub use sign_in::{SignInLimits, Whose};
pub use throttle::Throttle;
pub use trusted_proxies::TrustedProxies;
pub use written::{Pieces, written};
