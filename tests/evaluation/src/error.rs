//! Errors that end an evaluation before its report.

use std::path::PathBuf;

use fleetcal_estimator::stream::FieldRefused;
use fleetcal_robot::simulator::SettingRefused;
use thiserror::Error;

/// Reason for which an evaluation ends before its report.
#[derive(Debug, Error)]
pub enum EvaluationError {
    /// A study asks the simulator for an impossible setting.
    #[error("the simulator refuses a study's setting")]
    Simulation(#[from] SettingRefused),
    /// The simulator sent a message that the estimator refuses.
    #[error("the estimator refuses a simulated message")]
    Message(#[from] FieldRefused),
    /// A run ended without a result that the study needs.
    #[error("{study}: a run of seed {seed} has no {missing}")]
    Missing {
        /// Name of the study.
        study: &'static str,
        /// Seed of the run.
        seed: u64,
        /// Missing result.
        missing: &'static str,
    },
    /// A figure could not be drawn.
    #[error("the figure {name} cannot be drawn: {why}")]
    Figure {
        /// Its name.
        name: String,
        /// Error of the drawing library.
        why: String,
    },
    /// The report could not be written.
    #[error("{path} cannot be written")]
    Written {
        /// Path of the report.
        path: PathBuf,
        /// Error of the system.
        #[source]
        source: std::io::Error,
    },
    /// `fleetcal calibrate` failed on a recording.
    #[error("fleetcal calibrate {recording}: {why}")]
    Recording {
        /// Name of the recording.
        recording: String,
        /// Reason.
        why: String,
    },
}
