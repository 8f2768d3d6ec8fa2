//! Rounds of a cluster that is hurt, with a check of all that was decided, written and heard after
//! each; in `routers` of what was heard.

mod cuts;
mod failover;
mod failover_lock;
mod planted;
mod postmaster;
mod races;
mod routers;
mod takeovers;
mod verification;
mod webhooks;
