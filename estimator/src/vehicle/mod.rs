//! Vehicle models: how speed and steering move the rear axle.

use serde::{Deserialize, Serialize};

/// How the vehicle steers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VehicleModel {
    /// Steered front axle (Ackermann too), speed measured at the rear axle.
    Bicycle,
    /// One steered and driven front wheel, speed measured at that wheel.
    Tricycle,
}

/// Where the speed is measured.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpeedMeasuredAt {
    /// At the rear axle's centre.
    RearAxle,
    /// At the steered front wheel: `v = v_front * cos(steering_true)`.
    SteeredWheel,
    /// At one rear wheel, `lateral_m` to the left of the axle's centre.
    RearWheel {
        /// Position of the wheel along y of `base`, m.
        lateral_m: f64,
    },
}

/// A vehicle as it is configured.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Vehicle {
    /// How it steers.
    pub model: VehicleModel,
    /// Distance from the rear axle to the steered axle, m.
    pub wheelbase_m: f64,
    /// Where its speed is measured.
    pub speed_measured_at: SpeedMeasuredAt,
}

impl Vehicle {
    /// A vehicle whose speed is measured where its model usually measures it.
    pub fn new(model: VehicleModel, wheelbase_m: f64) -> Self {
        let speed_measured_at = match model {
            VehicleModel::Bicycle => SpeedMeasuredAt::RearAxle,
            VehicleModel::Tricycle => SpeedMeasuredAt::SteeredWheel,
        };
        Self { model, wheelbase_m, speed_measured_at }
    }
}
