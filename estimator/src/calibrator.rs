//! One robot's estimator: a pure `step(event) -> effects`.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::estimate::{Change, Estimate, Parameter, ParameterEstimate, Segment, Status};
use crate::geometry::Pose2;
use crate::settings::EstimatorSettings;
use crate::stream::{Effect, Event, Stamp};
use crate::vehicle::Vehicle;

/// What is known of a robot before it has driven.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CalibratorConfig {
    /// The vehicle.
    pub vehicle: Vehicle,
    /// The LiDAR's pose in `base` from CAD or tape, when there is one.
    pub nominal_lidar_in_base: Option<Pose2>,
    /// Settings of the filter.
    pub settings: EstimatorSettings,
}

/// A calibrator's state, to be stored and restored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    version: u32,
    stamp: Stamp,
}

/// Why a checkpoint could not be used.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum CheckpointRefused {
    /// It was written by another version of the estimator.
    #[error("the checkpoint is of version {found}, this estimator reads version {wanted}")]
    Version {
        /// Version in the checkpoint.
        found: u32,
        /// Version that can be read.
        wanted: u32,
    },
}

/// One robot's estimator.
#[derive(Debug, Clone)]
pub struct Calibrator {
    config: CalibratorConfig,
}

impl Calibrator {
    /// An estimator that knows nothing yet but its vehicle.
    pub fn new(config: CalibratorConfig) -> Self {
        Self { config }
    }

    /// An estimator that goes on from a checkpoint, under a new anchor and local map.
    ///
    /// # Errors
    /// When the checkpoint is of another version.
    pub fn restore(
        config: CalibratorConfig,
        _checkpoint: &Checkpoint,
    ) -> Result<Self, CheckpointRefused> {
        Ok(Self { config })
    }

    /// What has to be stored to go on later.
    pub fn checkpoint(&self) -> Checkpoint {
        Checkpoint { version: 1, stamp: Stamp(0) }
    }

    /// Takes one event and says what has to be done.
    pub fn step(&mut self, _event: Event) -> Vec<Effect> {
        Vec::new()
    }

    /// The configuration it was made with.
    pub fn config(&self) -> &CalibratorConfig {
        &self.config
    }

    /// The estimate now.
    pub fn estimate(&self) -> Estimate {
        let unknown = ParameterEstimate {
            value: 0.0,
            sigma: 0.0,
            status: Status::Unobservable,
            needs: None,
        };
        Estimate {
            stamp: Stamp(0),
            time_s: 0.0,
            distance_m: 0.0,
            parameters: Parameter::ALL.map(|_| unknown.clone()),
            consistency: crate::estimate::Consistency::default(),
            counts: crate::estimate::Counts::default(),
            base_in_odom: Pose2::IDENTITY,
            drive_now: [0.0; 2],
        }
    }

    /// Changes and faults of this session, oldest first.
    pub fn changes(&self) -> &[Change] {
        &[]
    }

    /// The stretches of this session over which the vehicle stayed the same.
    pub fn segments(&self) -> Vec<Segment> {
        Vec::new()
    }
}
