//! Imperfections of a simulated robot, beyond the estimator's model of a robot.
//!
//! Everything here is zero by default, and a robot of zeros sends bit for bit what it sent before
//! this type existed. Angles are in radians, shares are relative (0.01 is 1 %).

mod check;
mod kind;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

pub use kind::{ImperfectionKind, Strength};

/// Angle at which [`VehicleImperfections`] gives the deviations of the steering curve: 20°.
pub const CURVE_REFERENCE_RAD: f64 = 20.0 / 180.0 * std::f64::consts::PI;
/// Angle of incidence at which [`ScannerImperfections::incidence_bias_m`] is given: 60°.
pub const INCIDENCE_REFERENCE_RAD: f64 = std::f64::consts::FRAC_PI_3;

/// All imperfections of one robot, by the part of the robot that has them.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Imperfections {
    /// Steering, wheels and tyres.
    pub vehicle: VehicleImperfections,
    /// The LiDAR, whether it sends scans or poses.
    pub lidar: LidarImperfections,
    /// Single beams. They act on raw scans and are refused for a robot that sends poses: a pose
    /// has no beams.
    pub scanner: ScannerImperfections,
    /// Stamps and lost messages of both streams.
    pub clocks: ClockImperfections,
}

/// Imperfections of steering, wheels and tyres.
///
/// Each is described with its effect when the drive is *mirrored* (left for right) and *reversed*
/// (the same steering, the speed with the other sign). Unless stated otherwise it stays: linkages,
/// sensors and wheels depend on angles and time, not on the direction of rolling.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VehicleImperfections {
    /// Gain `g` of the steering: with `u` the shown angle less its offset,
    /// `steering_true = (1 + g + a·sign(u))·u + q·(u/20°)² + c·(u/20°)³`. Share.
    pub steering_gain: f64,
    /// Asymmetry `a` of the steering: the gain is larger by this to the left and smaller by it to
    /// the right. Share. Mirrored it changes sign.
    pub steering_asymmetry: f64,
    /// Quadratic term `q` of the steering: its deviation at 20°, rad. From 45° on the curve
    /// continues straight. Mirrored it changes sign.
    pub steering_quadratic_rad: f64,
    /// Cubic term `c` of the steering: its deviation at 20°, rad. From 45° on the curve continues
    /// straight.
    pub steering_cubic_rad: f64,
    /// Play between steering sensor and wheel, from one end to the other, rad. The wheel stays
    /// until the sensor's side pushes it: `wheel = clamp(wheel, side - play/2, side + play/2)`.
    pub backlash_rad: f64,
    /// Time constant with which the wheel follows the angle that the wheel odometry shows, s: a
    /// servo whose command is sent as its angle. The speed does not lag.
    pub steering_lag_s: f64,
    /// Delay of an angle in the wheel odometry against the speed of the same moment, s.
    pub steering_delay_s: f64,
    /// Step of the steering encoder on a robot whose wheel does not tremble, rad: in place of the
    /// configured step, and localisation and steering are without noise. 0 leaves all three.
    pub undithered_step_rad: f64,
    /// Configured wheelbase over the true one, less 1. The robot follows its path with the
    /// configured one, and a calibration is configured with that one.
    pub wheelbase: f64,
    /// Unequal wheels `e`: the left rear wheel is larger by this share than the encoder assumes,
    /// the right one smaller. With half a track `h` of 0.4 wheelbases the mean of both shows
    /// `(v + e·h·yaw_rate)/(1 - e²)`. A tricycle measures at one wheel and has no such mean. Mirrored
    /// it changes sign.
    pub wheel_sizes: f64,
    /// Place of the speed measurement, to the left of the axle's middle, m: `speed_shown = v -
    /// y·yaw_rate`. Mirrored it changes sign.
    pub speed_encoder_y_m: f64,
    /// Slip angle of the rear axle for each m/s² of lateral acceleration, outwards, rad:
    /// `side_speed = |v|·tan(-slip·v·yaw_rate)`, the same backwards as forwards, as the force on
    /// the tyres points into the bend both times.
    pub side_slip_rad_per_mps2: f64,
    /// Slip angle of the front axle beyond the rear one's, for each m/s² of lateral acceleration,
    /// rad: `yaw_rate = v·tan(steering)/(wheelbase + understeer·|v|·v)`. The force is the same both
    /// ways, but the axle that leads is not: backwards understeer narrows the bend.
    pub understeer_rad_per_mps2: f64,
}

/// Imperfections of a LiDAR that its scans and the poses of its odometry share.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LidarImperfections {
    /// Scans or poses in a second, in place of the configured number.
    pub scan_rate_hz: Option<f64>,
    /// Measured lengths over true ones, less 1: for scans of their ranges, for poses of their
    /// positions.
    pub range_scale: f64,
}

/// Imperfections of a scanner's beams.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScannerImperfections {
    /// Bias of every range, m.
    pub range_bias_m: f64,
    /// Bias of a range at 60° of incidence, m: `bias·(1 - cos(incidence))/(1 - cos(60°))`. People
    /// are met at 0°.
    pub incidence_bias_m: f64,
    /// True if `time_increment` is sent as 0 although the beams are measured one after another.
    pub untimed_beams: bool,
    /// True if a scan is stamped at its last beam instead of its first.
    pub stamped_at_end: bool,
    /// Probability that a beam between two surfaces whose ranges differ by more than 0.15 m shows
    /// a range between them.
    pub mixed_pixels: f64,
    /// Tilt of the scanning plane, rad. The LiDAR is 0.2 m above the floor, which the lower beams
    /// may meet.
    pub tilt_rad: f64,
    /// Direction in the LiDAR's frame in which a tilted plane points down, rad.
    pub tilt_direction_rad: f64,
}

/// Imperfections of stamps and of the network.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ClockImperfections {
    /// Rate of the wheel odometry's clock over the LiDAR's, less 1: 1e-4 is 100 ppm.
    pub drive_drift: f64,
    /// Standard deviation of every stamp of both streams, s; a stream's stamps still increase.
    pub stamp_jitter_s: f64,
    /// Share of the messages of both streams that are lost.
    pub lost_messages: f64,
}

impl Imperfections {
    /// True if there is no imperfection.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}
