//! What a robot's task goes on from after a restart of the service.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::{Calibrator, Checkpoint};
use fleetcal_model::RobotId;
use serde::{Deserialize, Serialize};

use crate::candidate::Candidate;
use crate::packed::{self, Unreadable};
use crate::verification_run::{StoredRun, VerificationRun};

/// What is stored of a robot's task. One whose estimator is configured otherwise by now begins from
/// nothing. What former versions did not store is absent in theirs.
#[derive(Debug, Serialize, Deserialize)]
pub struct Stored {
    /// What the estimators were made with.
    pub config: CalibratorConfig,
    /// The robot's own estimator.
    pub calibrator: Checkpoint,
    /// Whether a change was seen and the new values are not known yet.
    #[serde(default)]
    pub changed: bool,
    /// How long the estimate has stood still.
    #[serde(default)]
    pub candidate: Candidate,
    /// The estimator of values in verification.
    #[serde(default)]
    pub verification_run: Option<StoredRun>,
}

impl Stored {
    /// As the store keeps it.
    ///
    /// # Errors
    /// When it cannot be packed.
    pub fn to_bytes(&self) -> Result<Vec<u8>, Unreadable> {
        packed::pack(self)
    }
}

/// The part of a stored state that is the robot's estimator, which is equal to the bit where two
/// estimators were; `None` of bytes that this version cannot read. The rest also depends on when
/// somebody looked at the estimate.
pub fn estimator_of(stored: &[u8]) -> Option<Vec<u8>> {
    let stored: Stored = packed::unpack(stored).ok()?;
    packed::pack(&stored.calibrator).ok()
}

/// What a robot's task begins with.
#[derive(Debug)]
pub struct Restored {
    /// The robot's own estimator.
    pub calibrator: Calibrator,
    /// Whether a change was seen and the new values are not known yet.
    pub changed: bool,
    /// How long the estimate has stood still.
    pub candidate: Candidate,
    /// The estimator of values in verification.
    pub verification_run: Option<VerificationRun>,
}

impl Restored {
    /// The beginning of a robot of which nothing is known.
    pub fn nothing(config: &CalibratorConfig) -> Self {
        Self {
            calibrator: Calibrator::new(config.clone()),
            changed: false,
            candidate: Candidate::default(),
            verification_run: None,
        }
    }
}

/// What was stored as `bytes`; `None`, which is logged, when they cannot be read or are of an
/// estimator with another configuration.
pub fn restore(robot: &RobotId, config: &CalibratorConfig, bytes: &[u8]) -> Option<Restored> {
    let stored: Stored = match packed::unpack(bytes) {
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
    let run = stored.verification_run.as_ref();
    let run = run.map(|run| VerificationRun::restore(config, run));
    let restored = Calibrator::restore(config.clone(), &stored.calibrator).and_then(|calibrator| {
        Ok(Restored {
            calibrator,
            changed: stored.changed,
            candidate: stored.candidate,
            verification_run: run.transpose()?,
        })
    });
    restored
        .inspect_err(|error| {
            tracing::warn!(robot.id = %robot, %error, "estimator begins from nothing");
        })
        .ok()
}
