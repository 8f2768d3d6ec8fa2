//! Simulated robots past the whole estimator: consistency, changes, and what cannot be known.

mod changes;
mod consistency;
mod drive;
mod observability;
mod restarts;
