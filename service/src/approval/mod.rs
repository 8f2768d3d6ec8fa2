//! From estimate to robot: what is proposed, approved, offered, applied and proven.
//!
//! Pure: no clock, no database, no wire. Four records, never one status column: a [`Revision`] is
//! what was found, a [`Proposal`] asks people for it, a [`Deployment`] brings it to one robot, and
//! the [`Shadow`] says what the robot should use and what it reported. A [`RobotLedger`] holds
//! those of one robot that can still change; [`step`] takes a [`Command`] and gives the records
//! anew, with one [`Transition`] for each change, or refuses and changes nothing. [`due`] says
//! which command time and the estimates ask for.

mod answer;
mod ask;
mod command;
mod deployment;
mod draft;
mod due;
mod ledger;
mod policy;
mod proposal;
mod revision;
mod rollback;
mod shadow;
mod step;
mod values;

#[cfg(test)]
mod tests;

pub use command::{Command, Refused, Standing};
pub use deployment::{Deployment, DeploymentEvent, DeploymentState, GenerationRef, Verification};
pub use due::{Candidate, Situation, Verdict, automatic, due, judge};
pub use ledger::{NextIds, Outcome, Parcel, RobotLedger, Subject, Transition};
pub use policy::{Policy, Tolerance};
pub use proposal::{Approval, Closing, Proposal, ProposalEvent, ProposalState};
pub use revision::{Evidence, Origin, Revision};
pub use shadow::{InUse, Reported, Shadow};
pub use step::step;
pub use values::{Change, difference, nominal_values, values_and_sigmas};
