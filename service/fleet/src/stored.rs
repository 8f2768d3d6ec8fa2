//! A robot's estimator as the store keeps it, to go on from after a restart of the service.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::{Calibrator, Checkpoint};
use fleetcal_model::RobotId;
use serde::{Deserialize, Serialize};

/// A stored estimator: its state, and what it was made with. A robot that is configured otherwise
/// by now begins from nothing.
#[derive(Debug, Serialize, Deserialize)]
pub struct Stored {
    config: CalibratorConfig,
    calibrator: Checkpoint,
}

impl Stored {
    /// The state of an estimator that was made with `config`.
    pub const fn new(config: CalibratorConfig, calibrator: Checkpoint) -> Self {
        Self { config, calibrator }
    }
}

/// The estimator that was stored as `json`; `None`, which is logged, when it cannot be read or was
/// made with another configuration.
pub fn restore(robot: &RobotId, config: &CalibratorConfig, json: &str) -> Option<Calibrator> {
    let stored: Stored = match serde_json::from_str(json) {
        Ok(stored) => stored,
        Err(error) => {
            tracing::warn!(robot.id = %robot, %error, "stored estimator cannot be read");
            return None;
        }
    };
    if stored.config != *config {
        tracing::info!(robot.id = %robot, "configured otherwise: estimator begins from nothing");
        return None;
    }
    match Calibrator::restore(config.clone(), &stored.calibrator) {
        Ok(calibrator) => Some(calibrator),
        Err(error) => {
            tracing::warn!(robot.id = %robot, %error, "estimator begins from nothing");
            None
        }
    }
}
