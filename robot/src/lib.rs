//! The robot's side of the wire: simulator, recordings and their replay, and the agent that
//! brings approved calibrations into use.
//!
//! Without the feature `wire` the crate is the pure, seeded [`simulator`] alone.

#[cfg(feature = "wire")]
pub mod agent;
#[cfg(feature = "wire")]
mod connection;
#[cfg(feature = "wire")]
pub mod fleet;
#[cfg(feature = "wire")]
pub mod recording;
#[cfg(feature = "wire")]
pub mod replay;
#[cfg(feature = "wire")]
mod session;
#[cfg(feature = "wire")]
mod session_error;
pub mod simulator;

#[cfg(feature = "wire")]
pub use connection::Connection;
