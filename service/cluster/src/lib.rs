//! Assignment of estimators to the instances of a cluster, decided from rows alone.
//!
//! Each process of `fleetcal serve` has one lease, and each robot one row with the instance that
//! estimates it. The rows state the present owners; [`plan`] computes the desired ones. Exclusion
//! rests on the database: a write names its [`Tenure`], and the transaction that writes it holds
//! the row of the instance's lease. Publications over Zenoh check the [`Lease`], whose time ends
//! before the database's does.
//!
//! This crate uses no database, network or clock.

mod assignment;
mod duty;
mod hearing;
mod lease;
mod link_report;
mod listening;
mod member;
mod membership;
mod plan;
mod sightings;
mod tenure;

pub use assignment::{Assignment, assign};
pub use duty::Duty;
pub use hearing::Hearing;
pub use lease::Lease;
pub use link_report::{HEARTBEAT_EVERY, HEARTBEATS_MISSING_AFTER, LinkReport, Silence};
pub use listening::Listening;
pub use member::Member;
pub use membership::{Cluster, Membership, Takeover, Whereabouts};
pub use plan::{DutyOwnership, Handover, Ownership, Plan, Snapshot, plan};
pub use sightings::{cluster_sightings, homeless};
pub use tenure::{ClaimId, Epoch, Incarnation, Seat, Tenure};

pub use fleetcal_proto::key::ServiceInstance as InstanceId;
