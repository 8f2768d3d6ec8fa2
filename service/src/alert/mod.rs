//! What operators are called for: which robot needs what, since when, and who has seen it.
//!
//! Pure: no clock, no database, no wire. [`sightings`] holds each rule against a robot's view and
//! its records; [`step`] takes what a rule saw and moves the one active [`Alert`] of that robot
//! and kind on. Whether something is wrong ([`Condition`]) and whether somebody has taken it on
//! ([`Acknowledgement`]) are two axes: neither changes the other.

mod condition;
mod document;
mod kind;
mod policy;
mod record;
mod rules;

#[cfg(test)]
mod tests;

pub use condition::{Condition, ConditionName, Observation, Periods};
pub use document::{AcknowledgementDocument, AlertDocument};
pub use kind::{AlertKind, Severity};
pub use policy::AlertPolicy;
pub use record::{Acknowledgement, Alert, AlertRefused, Notice, Step, step};
pub use rules::{Sighting, Situation, sightings};
