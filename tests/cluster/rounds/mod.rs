//! Rounds of a cluster that is hurt, with a check of all that was decided, written and heard after
//! each.

mod cuts;
mod failover;
mod failover_lock;
mod planted;
mod postmaster;
mod races;
mod takeovers;
