//! Alerts: their rules, conditions and acknowledgements.
//!
//! Pure: no clock, no database, no wire. [`sightings`] evaluates each rule on a robot's view and
//! its records; [`group_silent`] merges robots that fall silent together; [`step`] applies a rule's
//! sighting to the one active [`Alert`] of that robot and kind. The problem ([`Condition`]) and its
//! [`Acknowledgement`] are independent: neither changes the other.

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
pub use rules::{Sighting, Situation, sessions_full, sightings};
pub use subject::Subject;
