//! Staged deployments, pure: a [`Rollout`] brings approved calibrations to robots in waves.
//!
//! 1. A person decides: the roll-out holds that person's approval of each [`Member`]'s proposal,
//!    bound to its revision. [`split`] makes the waves of a plan.
//! 2. A wave that begins releases the approvals of its robots, by the rules of a single approval.
//!    A proposal that has changed since is no longer what was approved: its robot is left out.
//! 3. [`due`] compares the [`Counts`] of each wave with its thresholds: the next wave begins when
//!    enough robots are verified, and the roll-out halts when too many have failed or too few can
//!    still be verified. It decides nothing else, so that it can be asked again at any time, by any
//!    instance, after any restart.
//!
//! The stage of a robot follows from its proposal and deployment and is stored nowhere.

mod due;
mod member;
mod plan;
mod rollout;

pub use due::due;
pub use member::{Brought, Counts, Followed, Lost, Member, Stage, plan_sha256};
pub use plan::{PlanRefused, Take, WavePlan, split};
pub use rollout::{Approver, Changed, Event, Rollout, RolloutRefused, RolloutState, Wave};
