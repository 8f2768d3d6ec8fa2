//! Errors that end an evaluation before its report.

use std::path::PathBuf;

use fleetcal_estimator::stream::FieldRefused;
use fleetcal_robot::simulator::SettingRefused;
use thiserror::Error;

/// Why an evaluation ends before its report.
#[derive(Debug, Error)]
pub enum EvaluationError {
    /// A study asks the simulator for what it cannot do.
    #[error("the simulator refuses a study's setting")]
    Simulation(#[from] SettingRefused),
    /// The simulator sent what the estimator does not take.
    #[error("the estimator refuses a simulated message")]
    Message(#[from] FieldRefused),
    /// A run ended without what the study needs of it.
    #[error("{study}: a run of seed {seed} has no {missing}")]
    Missing {
        /// Which study.
        study: &'static str,
        /// Which seed.
        seed: u64,
        /// What is not there.
        missing: &'static str,
    },
    /// A figure could not be drawn.
    #[error("the figure {name} cannot be drawn: {why}")]
    Figure {
        /// Its name.
        name: String,
        /// What the drawing library says.
        why: String,
    },
    /// The report could not be written.
    #[error("{path} cannot be written")]
    Written {
        /// Where to.
        path: PathBuf,
        /// Why.
        #[source]
        source: std::io::Error,
    },
    /// `fleetcal calibrate` did not do its work on a recording.
    #[error("fleetcal calibrate {recording}: {why}")]
    Recording {
        /// Which recording.
        recording: String,
        /// What went wrong.
        why: String,
    },
}
