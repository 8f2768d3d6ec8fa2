//! Estimate of a robot: values, their sigmas, and the motion that is missing.

pub use fleetcal_model::{
    CalibrationCovariance, Cause, ChangeKind, Consistency, Counts, Detection, DetectionState,
    Innovation, ModelFit, Parameter, ParameterStatus as Status, SigmaEffect, SigmaSource,
    SigmaTerm, SteeringPoint, SteeringTable, SteeringTableStatus,
};
use serde::{Deserialize, Serialize};

use crate::geometry::Pose2;
use crate::stream::RobotTime;

/// One parameter's estimate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParameterEstimate {
    /// Value, in the parameter's unit.
    pub value: f64,
    /// Standard deviation, same unit; 0 when the parameter is off.
    pub sigma: f64,
    /// Degree to which it is known.
    pub status: Status,
    /// Motion that would make it better known, in words; `None` when nothing is missing.
    pub needs: Option<String>,
}

/// One estimate for each of [`Parameter::ALL`].
pub type ParameterEstimates = [ParameterEstimate; Parameter::ALL.len()];

/// The state of one robot's calibration at one time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The time it is about.
    pub stamp: RobotTime,
    /// Seconds since the session's first message.
    pub time_s: f64,
    /// Distance driven in the session, m.
    pub distance_m: f64,
    /// The parameters, in the order of [`Parameter::ALL`].
    pub parameters: ParameterEstimates,
    /// True if somebody has reported a reassembly, and nothing is known again since.
    pub reassembly_open: bool,
    /// Covariance of the errors of the four that every calibration has; its diagonal holds the
    /// squares of their sigmas.
    pub covariance: CalibrationCovariance,
    /// Curve of the steering at the angles that were driven.
    pub steering_table: SteeringTable,
    /// State of detection for each cause: the changes that would be seen now, and the needs of the
    /// others.
    pub detection: Detection,
    /// Consistency of the filter.
    pub consistency: Consistency,
    /// Counts of the received messages.
    pub counts: Counts,
    /// Pose of `base` in the filter's odometry frame.
    pub base_in_odom: Pose2,
    /// Measured speed now, m/s, and measured steering now, rad.
    pub drive_now: [f64; 2],
}

impl Estimate {
    /// One parameter's estimate.
    pub fn parameter(&self, parameter: Parameter) -> &ParameterEstimate {
        let [offset, x, y, yaw, scale, wheelbase, time, gain] = &self.parameters;
        match parameter {
            Parameter::SteeringOffset => offset,
            Parameter::LidarX => x,
            Parameter::LidarY => y,
            Parameter::LidarYaw => yaw,
            Parameter::SpeedScale => scale,
            Parameter::Wheelbase => wheelbase,
            Parameter::TimeOffset => time,
            Parameter::SteeringGain => gain,
        }
    }
}

/// A detected change or fault.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// Kind of change.
    pub kind: ChangeKind,
    /// Cause.
    pub cause: Cause,
    /// Time of its flag.
    pub stamp: RobotTime,
    /// Time of its flag, in seconds since the session's first message.
    pub time_s: f64,
    /// Time of its onset, in seconds since the session's first message.
    pub onset_s: f64,
    /// New value less old value, for each parameter that was re-opened; filled in when known.
    pub change: Vec<(Parameter, f64)>,
}

/// A stretch of a session over which the vehicle stayed the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Segment {
    /// First second of the stretch.
    pub from_s: f64,
    /// Last second of the stretch.
    pub to_s: f64,
    /// The parameters at its end.
    pub parameters: ParameterEstimates,
}
