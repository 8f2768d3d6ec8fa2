//! Checkpoints of a robot's estimator: their times and content.

use fleetcal_domain::limits::{
    CHECKPOINT_CALIBRATED_EVERY_S, CHECKPOINT_EVERY_S, CHECKPOINT_OF_CLUSTER_MIN_S,
    CHECKPOINT_OF_CLUSTER_SHARE,
};

use fleetcal_model::RobotTime;

use super::good::Good;
use super::{Engine, RobotTask};
use crate::stored::{Stored, StoredConfig};
use crate::verification_run::VerificationRun;

impl RobotTask {
    /// Returns the message time between two checkpoints now, s. A takeover loses whatever an
    /// instance of a cluster has not stored.
    pub(super) fn checkpoint_every_s(&self) -> f64 {
        if self.fleet.membership.cluster().is_some() {
            let session_s = match &self.engine {
                Engine::Running(calibrator) => calibrator.duration_s(),
                Engine::Stopped => 0.0,
            };
            return (CHECKPOINT_OF_CLUSTER_SHARE * session_s)
                .clamp(CHECKPOINT_OF_CLUSTER_MIN_S, CHECKPOINT_EVERY_S);
        }
        if self.robot.is_settled() && self.verification_run.is_none() {
            CHECKPOINT_CALIBRATED_EVERY_S
        } else {
            CHECKPOINT_EVERY_S
        }
    }

    pub(crate) fn save_checkpoint(&mut self) {
        let Engine::Running(calibrator) = &self.engine else {
            return;
        };
        // A robot may have been silent since the task began, and a note about it may have come.
        let stamp = match self.newest {
            RobotTime(0) => calibrator.estimate().stamp,
            newest => newest,
        };
        // Of one that has never sent anything there is nothing to store but what people say.
        if stamp.0 <= 0 && !self.is_reassembly_open() {
            return;
        }
        let checkpoint = calibrator.checkpoint();
        self.earlier_good = self.last_good.replace(Good {
            checkpoint: checkpoint.clone(),
            changed: self.changed,
        });
        let run = self.verification_run.as_ref();
        let bytes = StoredConfig::of(&self.basis).and_then(|config| {
            let stored = Stored {
                config,
                calibrator: checkpoint,
                changed: self.changed,
                candidate: self.robot.candidate(),
                verification_run: run.map(VerificationRun::to_stored),
                notes: Some(self.notes.clone()),
                findings: self.robot.checks().named().cloned().collect(),
            };
            stored.to_bytes()
        });
        match bytes {
            Ok(state) => self
                .fleet
                .journal
                .save_checkpoint(&self.robot.id, stamp, state),
            Err(error) => {
                tracing::error!(robot.id = %self.robot.id, %error, "checkpoint not written");
            }
        }
    }
}
