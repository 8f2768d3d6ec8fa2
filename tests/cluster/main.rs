//! Several instances on one PostgreSQL and two Zenoh routers, as processes that are killed, frozen,
//! stopped and cut off.
//!
//! `make cluster-smoke` starts the server that `FLEETCAL_TEST_POSTGRES` names. `make cluster-test`
//! runs a few rounds of each kind, `make cluster-campaign` as many as a proof needs, and after each
//! round [`checker`] reads all that was decided, written and heard.
#![expect(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a test ends where it finds something wrong"
)]

mod balancer;
mod cell;
mod checker;
mod cluster;
mod cost;
mod decider;
mod figures;
mod lost_machine;
mod namespaces;
mod network;
mod patroni;
mod process;
mod processes;
mod progress;
mod receiver;
mod records;
mod rounds;
mod smoke;
mod stream;
mod trial;
mod twin;
mod upgrade;
mod watch;
