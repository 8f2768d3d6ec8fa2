//! Stored state from which a robot's task goes on after a restart of the service.

use fleetcal_domain::robot::{Basis, CheckFinding, Signals};
use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::{Calibrator, Checkpoint, Event, Note, Pose2, Vehicle};
use fleetcal_model::{NoteKind, RobotId, RobotTime};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::candidate::Candidate;
use crate::notes::NotesTaken;
use crate::packed::{self, Unreadable};
use crate::verification_run::{StoredRun, VerificationRun};

/// Stored state of a robot's task. If the estimator's configuration has changed since, only what
/// was reported about the robot is used. Fields that former versions did not store are absent in their states.
#[derive(Debug, Serialize, Deserialize)]
pub struct Stored {
    /// Configuration of the estimators.
    pub config: StoredConfig,
    /// The robot's own estimator.
    pub calibrator: Checkpoint,
    /// True if a change was detected and the new values are not known yet.
    #[serde(default)]
    pub changed: bool,
    /// Candidate for a proposal, with the time for which the estimate has been stable.
    #[serde(default)]
    pub candidate: Candidate,
    /// The verification run.
    #[serde(default)]
    pub verification_run: Option<StoredRun>,
    /// Notes that the estimator has processed; absent in states of former versions.
    #[serde(default)]
    pub notes: Option<NotesTaken>,
    /// Findings of the joining checks that name a cause.
    #[serde(default)]
    pub findings: Vec<CheckFinding>,
}

impl Stored {
    /// Packs the state for the store.
    ///
    /// # Errors
    /// The state cannot be packed.
    pub fn to_bytes(&self) -> Result<Vec<u8>, Unreadable> {
        packed::pack(self)
    }
}

/// Configuration of estimators in the form of the version that stored it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredConfig {
    vehicle: Vehicle,
    nominal_lidar_in_base: Option<Pose2>,
    settings: Value,
    /// Meaning of the robot's numbers; absent in states of former versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    signals: Option<Signals>,
}

impl StoredConfig {
    /// Makes the stored form of a configuration.
    ///
    /// # Errors
    /// The settings cannot be written as JSON.
    pub fn of(basis: &Basis) -> Result<Self, Unreadable> {
        let config = &basis.calibrator;
        Ok(Self {
            vehicle: config.vehicle,
            nominal_lidar_in_base: config.nominal_lidar_in_base,
            settings: serde_json::to_value(&config.settings)?,
            signals: Some(basis.signals.clone()),
        })
    }

    /// True if an estimator of this configuration can continue from the state. Settings that only
    /// one of the two versions knows are ignored: instances of both may serve while a cluster is
    /// upgraded.
    fn agrees_with(&self, basis: &Basis) -> bool {
        let config = &basis.calibrator;
        let signals = self.signals.as_ref();
        signals.is_none_or(|signals| *signals == basis.signals)
            && self.vehicle == config.vehicle
            && self.nominal_lidar_in_base == config.nominal_lidar_in_base
            && serde_json::to_value(&config.settings).is_ok_and(|own| agree(&self.settings, &own))
    }
}

/// True if settings are equal in all fields that both have.
fn agree(stored: &Value, own: &Value) -> bool {
    match (stored, own) {
        (Value::Object(stored), Value::Object(own)) => stored
            .iter()
            .filter_map(|(key, stored)| own.get(key).map(|own| (stored, own)))
            .all(|(stored, own)| agree(stored, own)),
        (Value::Number(stored), Value::Number(own)) => stored.as_f64() == own.as_f64(),
        _ => stored == own,
    }
}

/// Extracts the robot's estimator from a stored state, equal to the bit where two estimators were;
/// `None` if this version cannot read the bytes. The rest also depends on when somebody looked at
/// the estimate.
pub fn estimator_of(stored: &[u8]) -> Option<Vec<u8>> {
    let stored: Stored = packed::unpack(stored).ok()?;
    packed::pack(&stored.calibrator).ok()
}

/// State that a robot's task begins with.
#[derive(Debug)]
pub struct Restored {
    /// The robot's own estimator.
    pub calibrator: Calibrator,
    /// True if a change was detected and the new values are not known yet.
    pub changed: bool,
    /// Candidate for a proposal, with the time for which the estimate has been stable.
    pub candidate: Candidate,
    /// The verification run.
    pub verification_run: Option<VerificationRun>,
    /// Notes that it has processed, where they are known.
    pub notes: Option<NotesTaken>,
    /// Findings of the joining checks that named a cause.
    pub findings: Vec<CheckFinding>,
}

impl Restored {
    /// Makes the state of a robot whose estimator has another configuration now: what was reported
    /// about it stays.
    fn reported(config: &CalibratorConfig, stored: Stored) -> Self {
        let former = Calibrator::restore(config.clone(), &stored.calibrator);
        let mut restored = Self::nothing(config);
        restored.notes = stored.notes;
        if former.is_ok_and(|former| former.estimate().reassembly_open) {
            let stamp = RobotTime(0);
            let kind = NoteKind::Reassembled;
            restored.calibrator.step(Event::Note(Note { stamp, kind }));
        }
        restored
    }

    /// Makes the initial state of an unknown robot.
    pub fn nothing(config: &CalibratorConfig) -> Self {
        Self {
            calibrator: Calibrator::new(config.clone()),
            changed: false,
            candidate: Candidate::default(),
            verification_run: None,
            notes: None,
            findings: Vec::new(),
        }
    }
}

/// Restores a state from `bytes`; returns `None`, and logs it, if they cannot be read. Of an
/// estimator of another configuration only notes remain.
pub fn restore(robot: &RobotId, basis: &Basis, bytes: &[u8]) -> Option<Restored> {
    let stored: Stored = match packed::unpack(bytes) {
        Ok(stored) => stored,
        Err(error) => {
            tracing::warn!(robot.id = %robot, %error, "stored estimator cannot be read");
            return None;
        }
    };
    let config = &basis.calibrator;
    if !stored.config.agrees_with(basis) {
        tracing::info!(robot.id = %robot, "configured otherwise: estimator begins from nothing");
        return Some(Restored::reported(config, stored));
    }
    let run = stored.verification_run.as_ref();
    let run = run.map(|run| VerificationRun::restore(config, run));
    let restored = Calibrator::restore(config.clone(), &stored.calibrator).and_then(|calibrator| {
        Ok(Restored {
            calibrator,
            changed: stored.changed,
            candidate: stored.candidate,
            verification_run: run.transpose()?,
            notes: stored.notes,
            findings: stored.findings,
        })
    });
    restored
        .inspect_err(|error| {
            tracing::warn!(robot.id = %robot, %error, "estimator begins from nothing");
        })
        .ok()
}
