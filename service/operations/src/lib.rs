//! Operations of the service between the fleet and the store.
//!
//! Every write of a record is a [`fleetcal_store::Job`] here: it loads records, applies a pure step
//! of `fleetcal-domain`, and saves, in one transaction. [`accounts`] and [`robots`] have the jobs
//! that only people request. [`lifecycle`] stores decisions, one at a time for each robot, and
//! performs due commands each second; [`alert_evaluator`] compares every robot with the rules for
//! alerts; [`webhook_dispatcher`] sends webhooks; [`recording_export`] writes a recording of a
//! robot as MCAP. Their decisions are pure functions of `fleetcal-domain`. [`entropy`] is the
//! source of randomness, [`api_client`] reads from a running service for commands.
//!
//! For an instance of a cluster [`ownership`] keeps its lease and its robots, [`following`] follows
//! the others' decisions, and [`peers`] forwards requests for their robots to them.

pub mod accounts;
pub mod alert_evaluator;
mod answers;
pub mod api_client;
mod cause;
pub mod entropy;
pub mod following;
pub mod lifecycle;
pub mod notes;
pub mod ownership;
pub mod peers;
pub mod recording_export;
pub mod robots;
#[cfg(test)]
mod testing;
pub mod webhook_dispatcher;

use std::pin::Pin;

/// Future that is compiled in this crate, and not in each that awaits it.
pub type Boxed<T> = Pin<Box<dyn Future<Output = T> + Send>>;
