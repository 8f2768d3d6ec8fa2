//! The service among Zenoh's own tools: native configurations, a router's access list per robot,
//! certificates and passwords, a router before the service, and links that break.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test that cannot go on fails, and says what it has counted"
)]

mod breaks;
mod flood_kinds;
mod floods;
mod former_key;
mod growth;
mod link;
mod lists;
mod mesh;
mod native;
mod quic_streams;
pub mod raw_peer;
mod robot;
mod router;
mod routers;
mod senders;
mod session;
mod soak;
mod unfinished;
