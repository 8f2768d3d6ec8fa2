//! The command `fleetcal`: the commands of the service, and the service itself, which joins the
//! crates below `service/`.
//!
//! The data go one way: `fleetcal-link` (key, size, count) puts a message into its robot's bounded
//! mailbox; the robot's task in `fleetcal-fleet` decodes it and feeds the pure estimator; what the
//! estimator asks for is done: history to `fleetcal-store`, live updates to the event stream of
//! `fleetcal-api`, the estimate to `fleetcal-link`.

mod cluster;
pub mod command;
mod database;
pub mod environment;
mod memory;
pub mod service;
