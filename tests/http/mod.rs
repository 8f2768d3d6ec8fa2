//! HTTP against peers that are silent, slow, do not read, or are too many.
//!
//! `FLEETCAL_HTTP_FLOOD_S` says how long the flood lasts; `make hardening-http` has ten minutes.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod flood;
mod limits;
mod sign_in;
mod sockets;
