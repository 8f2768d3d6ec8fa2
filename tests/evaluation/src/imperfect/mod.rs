//! Imperfect robots: whether claims and alarms hold on vehicles that do not obey the model.
//!
//! A [`Cell`] is one imperfection at one strength on one route in one scenario; a [`Campaign`] runs
//! cells over seeds, and a [`Summary`] pools what the runs of a cell ended with.

mod campaign;
mod cell;
mod extent;
mod outcome;
mod robot;
mod run;
mod summary;
pub mod tables;
#[cfg(test)]
mod tests;

pub use campaign::{Campaign, Finished};
pub use cell::{Cell, Flaw, InjectedChange, Place, Road, Scenario, Sensor, Speed};
pub use extent::{Driven, ImperfectExtent};
pub use outcome::{ChangeOutcome, ClaimsOutcome, FALSE_SIGMAS, Flagged, Outcome, Snapshot};
pub use robot::robot;
pub use run::{Watch, run};
pub use summary::Summary;
