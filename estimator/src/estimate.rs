//! Estimate of a robot: values, their sigmas, and the motion that is missing.

pub use fleetcal_model::{
    CalibrationCovariance, Cause, ChangeKind, Consistency, Counts, Detection, DetectionState,
    Parameter, ParameterStatus as Status, SigmaEffect, SigmaSource, SigmaTerm,
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
    /// How far it is known.
    pub status: Status,
    /// In words, which motion would make it better known; `None` when nothing is missing.
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
    /// How the errors of the four that every calibration has go together; its diagonal holds the
    /// squares of their sigmas.
    pub covariance: CalibrationCovariance,
    /// Which changes would be seen now, and what the detection of the others waits for.
    pub detection: Detection,
    /// Consistency of the filter.
    pub consistency: Consistency,
    /// What was taken in.
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

/// A change or fault that was seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// What happened.
    pub kind: ChangeKind,
    /// Why.
    pub cause: Cause,
    /// When it was flagged.
    pub stamp: RobotTime,
    /// When it was flagged, in seconds since the session's first message.
    pub time_s: f64,
    /// When it began, in seconds since the session's first message.
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
