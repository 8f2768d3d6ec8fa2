//! What the service does by itself, between the fleet and the store.
//!
//! [`clerk`] takes decisions to the store, one at a time for each robot, and does each second what
//! is due; [`sentry`] holds every robot against the rules for alerts; [`courier`] sends webhooks;
//! [`session_export`] writes a robot's session as MCAP. What they decide by is pure and stands in
//! `fleetcal-domain`. [`entropy`] is where randomness enters.

pub mod clerk;
pub mod courier;
pub mod entropy;
pub mod sentry;
pub mod session_export;

use std::pin::Pin;

/// A future that is compiled in this crate, and not in each that awaits it.
pub type Boxed<T> = Pin<Box<dyn Future<Output = T> + Send>>;
