//! Alerts: which robot needs what, since when, and who has seen it.
//!
//! Pure: no clock, no database, no wire. [`sightings`] holds each rule against a robot's view and
//! its records; [`group_silent`] makes one of robots that fall silent together; [`step`] takes what a rule saw and moves the one active [`Alert`] of that robot
//! and kind on. Whether something is wrong ([`Condition`]) and whether somebody has taken it on
//! ([`Acknowledgement`]) are two axes: neither changes the other.

mod condition;
mod document;
mod group;
mod kind;
mod policy;
mod record;
mod rules;
mod subject;

#[cfg(test)]
pub(crate) mod tests;

pub use condition::{Condition, ConditionName, Observation, Periods};
pub use document::{AcknowledgementDocument, AlertDocument};
pub use group::group_silent;
pub use kind::{AlertKind, Severity};
pub use policy::AlertPolicy;
pub use record::{Acknowledgement, Alert, AlertRefused, Notice, Step, step};
pub use rules::{Sighting, Situation, sightings};
pub use subject::Subject;
