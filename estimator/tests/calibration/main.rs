//! Simulated robots past the whole estimator: consistency, changes, and what cannot be known.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![expect(
    clippy::print_stdout,
    reason = "figures are printed beside their bounds"
)]

mod changes;
mod consistency;
mod drive;
mod observability;
mod restarts;
