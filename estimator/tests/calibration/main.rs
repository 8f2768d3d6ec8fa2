//! Simulated robots past the whole estimator: consistency, changes, and what cannot be known.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![expect(
    clippy::print_stdout,
    reason = "figures are printed beside their bounds"
)]

mod changed;
mod changes;
mod consistency;
mod convergence;
mod delays;
mod disturbances;
mod disturbed;
mod drawn;
mod drive;
mod efficiency;
mod false_alarms;
mod imperfect_scanner;
mod imperfect_vehicle;
mod jumping_steering;
mod lost_odometry;
mod nonsense;
mod observability;
mod rear_steered;
mod reassemblies;
mod restarts;
mod restarts_in_motion;
mod reversed;
mod sigmas_after_restarts;
mod starts_in_motion;
mod steering_table;
#[expect(dead_code, reason = "an example measures each cause alone")]
mod synthetic_windows;
mod top_view;
mod typical;
mod unchanged;
