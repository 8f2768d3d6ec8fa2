//! The robot's side of the wire: simulator, recordings and their replay.
//!
//! Without the feature `wire` the crate is the pure, seeded [`simulator`] alone.

#[cfg(feature = "wire")]
pub mod fleet;
#[cfg(feature = "wire")]
pub mod recording;
#[cfg(feature = "wire")]
pub mod replay;
pub mod simulator;
