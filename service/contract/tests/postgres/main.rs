//! PostgreSQL beside SQLite, and PostgreSQL that fails: what only a real server shows.
//!
//! These tests fill the server that `FLEETCAL_TEST_POSTGRES` names with databases; those that stop
//! or kill a server start one of their own, as the user `postgres` where they run as root.
#![expect(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test ends where it finds something wrong"
)]

mod backup;
mod cluster;
mod commit;
mod copy;
mod decision;
mod differential;
mod failover;
mod postmaster;
mod proxy;
mod races;

mod startup;
