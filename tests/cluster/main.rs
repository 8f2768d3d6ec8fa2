//! Several instances on one PostgreSQL and two Zenoh routers, as processes that are killed, frozen,
//! stopped and cut off.
//!
//! `make cluster-smoke` starts the server that `FLEETCAL_TEST_POSTGRES` names.
#![expect(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stdout,
    reason = "a test ends where it finds something wrong"
)]

mod cluster;
mod smoke;
mod upgrade;
mod watch;
