//! Approval: proposals, decisions, offers, answers and verification on the way from estimate to
//! robot.
//!
//! Pure: no clock, no database, no wire. Four records, never one status column: a [`Revision`]
//! holds values with their evidence, a [`Proposal`] presents them to people, a [`Deployment`]
//! brings them to one robot, and the [`Shadow`] holds the robot's desired and reported calibration.
//! A [`RobotLedger`] has those of one robot that can still change; [`step`] applies a [`Command`]
//! to it and returns the new records, with one [`Transition`] for each change, or refuses and
//! changes nothing. [`due`] returns the command that time or an estimate makes due.

mod answer;
mod ask;
mod audited;
mod command;
mod deployment;
mod draft;
mod due;
mod four_eyes;
mod gain;
mod generation;
mod ledger;
mod lifecycle;
mod policy;
mod present;
mod proposal;
mod refused;
mod retirement;
mod revision;
mod rollback;
mod second_approver;
mod shadow;
mod step;
mod transition;
mod values;

#[cfg(test)]
mod tests;

pub use audited::audited;
pub use command::{Command, Standing};
pub use deployment::{Deployment, DeploymentEvent, DeploymentState, RollBack, Verification};
pub use due::{Objections, Situation, Verdict, automatic, due, judge};
pub use gain::{ExpectedGain, expected_gain};
pub use generation::{GenerationRef, InUse};
pub use ledger::{NextIds, OutboxEntry, Outcome, RobotLedger};
pub use policy::{Policy, PolicyRefused, Tolerance};
pub use present::{Outdated, Present, outdated};
pub use proposal::{Approval, Closing, Proposal, ProposalEvent, ProposalState, Refreshed};
pub use refused::{Refused, may_change};
pub use revision::{Evidence, Origin, Revision};
pub use second_approver::{Drawing, SecondApprover};
pub use shadow::{Contradicted, Maintenance, Reported, Retirement, Shadow, SyncState};
pub use step::step;
pub use transition::{Changed, DeploymentAction, ProposalAction, ShadowAction, Transition};
pub use values::{Change, difference, exceeds, nominal_values, values_and_sigmas};
