//! What an estimator says about a robot: values, their sigmas, and what it does not know.

use serde::{Deserialize, Serialize};

use crate::geometry::Pose2;
use crate::stream::Stamp;

/// A parameter of the calibration. The order is the order of every array of parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Parameter {
    /// `delta_off`: what the steering sensor shows when the wheel points straight ahead, rad.
    SteeringOffset,
    /// `x_off`: the LiDAR's position along x of `base`, m.
    LidarX,
    /// `y_off`: the LiDAR's position along y of `base`, m.
    LidarY,
    /// `theta_off`: the LiDAR's heading in `base`, rad.
    LidarYaw,
    /// True speed over measured speed.
    SpeedScale,
    /// Distance between the axles, m.
    Wheelbase,
    /// How much later a motion shows in the drive stream than in the LiDAR's, s.
    TimeOffset,
    /// True steering angle (less its offset) over the measured one.
    SteeringGain,
}

impl Parameter {
    /// All of them, in order.
    pub const ALL: [Self; 8] = [
        Self::SteeringOffset,
        Self::LidarX,
        Self::LidarY,
        Self::LidarYaw,
        Self::SpeedScale,
        Self::Wheelbase,
        Self::TimeOffset,
        Self::SteeringGain,
    ];

    /// Position in arrays of parameters.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The name in documents: `steering_offset`, `lidar_x` and so on.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SteeringOffset => "steering_offset",
            Self::LidarX => "lidar_x",
            Self::LidarY => "lidar_y",
            Self::LidarYaw => "lidar_yaw",
            Self::SpeedScale => "speed_scale",
            Self::Wheelbase => "wheelbase",
            Self::TimeOffset => "time_offset",
            Self::SteeringGain => "steering_gain",
        }
    }

    /// Its unit: `rad`, `m`, `s` or `1`.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::SteeringOffset | Self::LidarYaw => "rad",
            Self::LidarX | Self::LidarY | Self::Wheelbase => "m",
            Self::TimeOffset => "s",
            Self::SpeedScale | Self::SteeringGain => "1",
        }
    }
}

/// How far a parameter is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// Its sigma is inside its limit and the data behind it repeat it.
    Converged,
    /// On its way.
    Learning,
    /// The motions so far say nothing about it.
    Unobservable,
    /// Held at its configured value, with its configured doubt.
    Fixed,
    /// Not part of the model.
    Off,
}

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

/// Whether the filter's innovations are as large as it believes.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Consistency {
    /// Mean normalised innovation squared over the recent updates.
    pub nis_mean: f64,
    /// Its expectation: the degrees of freedom of one update.
    pub nis_dof: f64,
    /// How many updates the mean is over.
    pub samples: u64,
}

/// What was taken in since the session began.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Counts {
    /// Drive samples used.
    pub drive_samples: u64,
    /// Sweeps (or LiDAR poses) used.
    pub scans: u64,
    /// Sweeps that could not be used.
    pub scans_rejected: u64,
    /// Messages that came too late.
    pub late: u64,
    /// Messages that came twice.
    pub duplicates: u64,
}

/// The state of one robot's calibration at one time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The time it is about.
    pub stamp: Stamp,
    /// Seconds since the session's first message.
    pub time_s: f64,
    /// Distance driven in the session, m.
    pub distance_m: f64,
    /// The parameters, in the order of [`Parameter::ALL`].
    pub parameters: ParameterEstimates,
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

/// What kind of thing was seen to happen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ChangeKind {
    /// The vehicle is no longer the one that was calibrated.
    CalibrationChanged,
    /// The parts were reported as reassembled and the comparison came out equal.
    CalibrationConfirmed,
    /// A sensor or the LiDAR odometry failed for a while.
    Fault,
}

/// What the change came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// The steering zero moved.
    Steering,
    /// The LiDAR moved on the vehicle.
    LidarMount,
    /// Wheels or wheelbase changed.
    Vehicle,
    /// The LiDAR odometry failed.
    Odometry,
    /// The data do not tell.
    Unknown,
}

/// A change or fault that was seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// What happened.
    pub kind: ChangeKind,
    /// Why.
    pub cause: Cause,
    /// When it was flagged.
    pub stamp: Stamp,
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
