//! Settings of an estimator. Each key is a key of `[estimator]` in `fleetcal.toml`.

mod given;
mod measurement;

pub use measurement::Measurement;
use serde::{Deserialize, Serialize};

use crate::estimate::Parameter;
use crate::motion_noise::MotionNoise;

/// Freedom of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Freedom {
    /// Estimated from its prior.
    Estimated,
    /// Held at its value; its uncertainty stays in the other parameters' sigmas.
    Fixed,
    /// Assumed exactly right.
    Off,
}

/// One number for each parameter, in the parameter's unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PerParameter<T> {
    /// Number for the steering offset.
    pub steering_offset: T,
    /// Number for the LiDAR's x.
    pub lidar_x: T,
    /// Number for the LiDAR's y.
    pub lidar_y: T,
    /// Number for the LiDAR's yaw.
    pub lidar_yaw: T,
    /// Number for the speed scale.
    pub speed_scale: T,
    /// Number for the wheelbase.
    pub wheelbase: T,
    /// Number for the time offset.
    pub time_offset: T,
    /// Number for the steering gain.
    pub steering_gain: T,
}

impl<T> PerParameter<T> {
    /// The one of a parameter.
    pub fn get(&self, parameter: Parameter) -> &T {
        match parameter {
            Parameter::SteeringOffset => &self.steering_offset,
            Parameter::LidarX => &self.lidar_x,
            Parameter::LidarY => &self.lidar_y,
            Parameter::LidarYaw => &self.lidar_yaw,
            Parameter::SpeedScale => &self.speed_scale,
            Parameter::Wheelbase => &self.wheelbase,
            Parameter::TimeOffset => &self.time_offset,
            Parameter::SteeringGain => &self.steering_gain,
        }
    }
}

/// Settings of an estimator. `fleetcal.toml` documents each key with its default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EstimatorSettings {
    /// Former choice of a measurement: read, and written no more.
    #[serde(skip_serializing)]
    pub measurement: Measurement,
    /// Freedom of each parameter. Wheelbase and steering gain are never both estimated.
    #[serde(deserialize_with = "given::free")]
    pub free: PerParameter<Freedom>,
    /// Uncertainty before the first metre, one standard deviation. The wheelbase's is a share of it.
    #[serde(deserialize_with = "given::prior_sigma")]
    pub prior_sigma: PerParameter<f64>,
    /// Uncertainty of the LiDAR's x and y when no nominal mount is given, m.
    pub unknown_mount_sigma_m: f64,
    /// Drift of tyres outwards in a bend: standard deviation of the slip angle for each m/s^2 of
    /// lateral acceleration, rad.
    pub side_slip_sigma_rad_per_mps2: f64,
    /// Slow drift let in: standard deviation gained in one hour.
    #[serde(deserialize_with = "given::drift_per_sqrt_hour")]
    pub drift_per_sqrt_hour: PerParameter<f64>,
    /// Systematic errors that averaging cannot remove: the scan matcher's own bias, play,
    /// correlated slip. They are added to every sigma that leaves the estimator.
    #[serde(deserialize_with = "given::systematic_sigma")]
    pub systematic_sigma: PerParameter<f64>,
    /// Standard deviation below which a parameter is called converged.
    #[serde(deserialize_with = "given::converged_sigma")]
    pub converged_sigma: PerParameter<f64>,
    /// Largest distance of a vehicle's value from its neutral one: a value beyond is never called
    /// converged.
    #[serde(deserialize_with = "given::physical_limit")]
    pub physical_limit: PerParameter<f64>,
    /// Noise of a driven metre.
    pub motion_noise: MotionNoise,
    /// Noise of a given LiDAR pose that carries no covariance: position, m.
    pub pose_sigma_m: f64,
    /// Noise of a given LiDAR pose that carries no covariance: heading, rad.
    pub pose_sigma_rad: f64,
    /// Distance after which a new anchor is placed, m.
    pub anchor_distance_m: f64,
    /// Hours of driving with one false alarm of change detection.
    pub false_alarm_hours: f64,
    /// Largest time offset either way, s. Poses wait this much longer for their drive samples.
    pub time_offset_max_s: f64,
}

/// Limits that no vehicle on wheels exceeds.
const PHYSICAL_LIMIT: PerParameter<f64> = PerParameter {
    steering_offset: 15f64.to_radians(),
    lidar_x: 5.0,
    lidar_y: 3.0,
    lidar_yaw: std::f64::consts::TAU,
    speed_scale: 0.2,
    wheelbase: 10.0,
    time_offset: 0.25,
    steering_gain: 0.5,
};

impl Default for EstimatorSettings {
    fn default() -> Self {
        use Freedom::{Estimated, Fixed, Off};
        Self {
            measurement: Measurement::Clone,
            free: PerParameter {
                steering_offset: Estimated,
                lidar_x: Estimated,
                lidar_y: Estimated,
                lidar_yaw: Estimated,
                speed_scale: Estimated,
                wheelbase: Fixed,
                time_offset: Estimated,
                steering_gain: Off,
            },
            prior_sigma: PerParameter {
                steering_offset: 0.15,
                lidar_x: 0.1,
                lidar_y: 0.1,
                lidar_yaw: 0.1,
                speed_scale: 0.02,
                wheelbase: 0.005,
                time_offset: 0.05,
                steering_gain: 0.02,
            },
            unknown_mount_sigma_m: 1.5,
            side_slip_sigma_rad_per_mps2: 0.003,
            drift_per_sqrt_hour: PerParameter {
                steering_offset: 0.000_3,
                lidar_x: 0.000_3,
                lidar_y: 0.000_3,
                lidar_yaw: 0.000_15,
                speed_scale: 0.000_3,
                wheelbase: 0.0,
                time_offset: 0.01,
                steering_gain: 0.0,
            },
            systematic_sigma: PerParameter {
                steering_offset: 0.000_1,
                lidar_x: 0.000_5,
                lidar_y: 0.000_5,
                lidar_yaw: 0.000_15,
                // A tyre's rolling radius changes by as much with load and warmth.
                speed_scale: 0.001,
                wheelbase: 0.0,
                time_offset: 0.002,
                steering_gain: 0.0,
            },
            converged_sigma: PerParameter {
                steering_offset: 0.05f64.to_radians(),
                lidar_x: 0.005,
                lidar_y: 0.005,
                lidar_yaw: 0.1f64.to_radians(),
                speed_scale: 0.002,
                wheelbase: 0.005,
                time_offset: 0.01,
                steering_gain: 0.005,
            },
            physical_limit: PHYSICAL_LIMIT,
            motion_noise: MotionNoise::default(),
            pose_sigma_m: 0.003,
            pose_sigma_rad: 0.000_5,
            anchor_distance_m: 3.0,
            false_alarm_hours: 10_000.0,
            time_offset_max_s: 0.25,
        }
    }
}

/// Reason for which settings were refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SettingsRefused {
    /// Wheelbase and gain both estimated: no motion distinguishes them.
    #[error("free.wheelbase and free.steering_gain are both estimated; one of them must be fixed")]
    WheelbaseAndGain,
    /// Measurement of the paper's own filter, which is part of the evaluation alone.
    #[error("measurement: got anchored, expected no such key: the paper's own filter is gone")]
    Anchored,
    /// Number that must be positive and is not.
    #[error("{key}: got {value}, expected a number above 0")]
    NotPositive {
        /// The key.
        key: String,
        /// Its value.
        value: f64,
    },
}

impl EstimatorSettings {
    /// Freedom of a parameter.
    pub fn freedom(&self, parameter: Parameter) -> Freedom {
        *self.free.get(parameter)
    }

    /// Refuses impossible settings.
    ///
    /// # Errors
    /// Names the key, its value and the accepted values.
    pub fn check(&self) -> Result<(), SettingsRefused> {
        if self.measurement == Measurement::Anchored {
            return Err(SettingsRefused::Anchored);
        }
        if self.free.wheelbase == Freedom::Estimated
            && self.free.steering_gain == Freedom::Estimated
        {
            return Err(SettingsRefused::WheelbaseAndGain);
        }
        for parameter in Parameter::ALL {
            positive(
                || format!("prior_sigma.{}", parameter.name()),
                *self.prior_sigma.get(parameter),
            )?;
            let limit = *self.converged_sigma.get(parameter);
            positive(|| format!("converged_sigma.{}", parameter.name()), limit)?;
            let limit = *self.physical_limit.get(parameter);
            positive(|| format!("physical_limit.{}", parameter.name()), limit)?;
        }
        for (key, value) in [
            ("unknown_mount_sigma_m", self.unknown_mount_sigma_m),
            (
                "side_slip_sigma_rad_per_mps2",
                self.side_slip_sigma_rad_per_mps2,
            ),
            ("pose_sigma_m", self.pose_sigma_m),
            ("pose_sigma_rad", self.pose_sigma_rad),
            ("anchor_distance_m", self.anchor_distance_m),
            ("false_alarm_hours", self.false_alarm_hours),
            ("time_offset_max_s", self.time_offset_max_s),
            (
                "motion_noise.along_m_per_sqrt_m",
                self.motion_noise.along_m_per_sqrt_m,
            ),
            (
                "motion_noise.across_m_per_sqrt_m",
                self.motion_noise.across_m_per_sqrt_m,
            ),
            (
                "motion_noise.yaw_rad_per_sqrt_m",
                self.motion_noise.yaw_rad_per_sqrt_m,
            ),
            (
                "motion_noise.steering_rad_sqrt_m",
                self.motion_noise.steering_rad_sqrt_m,
            ),
        ] {
            positive(|| key.to_owned(), value)?;
        }
        Ok(())
    }
}

fn positive(key: impl FnOnce() -> String, value: f64) -> Result<(), SettingsRefused> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(SettingsRefused::NotPositive { key: key(), value })
    }
}
