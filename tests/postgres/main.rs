//! A service on PostgreSQL, as a process: what it says when it cannot have its database, and what it
//! does while that is away.
//!
//! `FLEETCAL_TEST_POSTGRES` names a server that may be filled with databases; those that are stopped
//! are the tests' own.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod away;
mod commands;
mod refusals;
