//! Operations of the service between the fleet and the store.
//!
//! Every write of a record is a [`fleetcal_store::Job`] here: it loads records, takes a pure step of
//! `fleetcal-domain`, and saves, in one transaction. [`accounts`] and [`robots`] have those that
//! people ask for alone. [`lifecycle`] takes decisions to the store, one at a time for each robot,
//! and does each second what is due; [`alert_evaluator`] compares every robot with the rules for
//! alerts; [`webhook_dispatcher`] sends webhooks; [`recording_export`] writes a recording of a robot
//! as MCAP. What they decide by is pure and is in `fleetcal-domain`. [`entropy`] is where randomness
//! enters.
//!
//! Of an instance of a cluster [`ownership`] keeps the place, [`following`] hears what others
//! decide, and [`peers`] has them answer for their own robots.

pub mod accounts;
pub mod alert_evaluator;
mod answers;
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

/// A future that is compiled in this crate, and not in each that awaits it.
pub type Boxed<T> = Pin<Box<dyn Future<Output = T> + Send>>;
