//! Decisions of the service, without I/O: access of users and programs ([`access`]), the way of a
//! calibration from a proposal to its robot ([`approval`]), the problems of a robot ([`alert`]),
//! its standing ([`standing`]) and [`deviation`], and the messages about them ([`webhook`]).
//!
//! Pure: the clock and randomness are arguments; no database, no wire, no async. [`robot`] and
//! [`streams`] describe a robot's configuration and state; [`limits`] holds every bound of the
//! service by name.

pub mod access;
pub mod alert;
pub mod approval;
pub mod audit;
pub mod deviation;
pub mod robot;
pub mod standing;
pub mod streams;
pub mod timestamp;
pub mod webhook;

pub use fleetcal_limits as limits;
