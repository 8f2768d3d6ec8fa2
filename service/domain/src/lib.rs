//! Decisions of the service, without any outside world: who may do what ([`access`]), how
//! a calibration gets from a proposal to its robot ([`approval`]), what is wrong with a robot
//! ([`alert`]), how it stands ([`standing`]) and who is told of it ([`webhook`]).
//!
//! Pure: the clock and randomness are arguments; no database, no wire, no async. [`robot`] and
//! [`streams`] describe a robot's configuration and state; [`limits`] holds every bound of the
//! service by name.

pub mod access;
pub mod alert;
pub mod approval;
pub mod audit;
pub mod robot;
pub mod standing;
pub mod streams;
pub mod timestamp;
pub mod webhook;

pub use fleetcal_limits as limits;
