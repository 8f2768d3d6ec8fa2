//! Kinds of vehicles.

use serde::{Deserialize, Serialize};
use strum::{IntoStaticStr, VariantArray};

/// Steering geometry of a vehicle and place of its speed measurement.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
    IntoStaticStr,
    VariantArray,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum VehicleModel {
    /// Steered front axle (Ackermann too), speed measured at the rear axle.
    Bicycle,
    /// One steered and driven front wheel, speed measured at that wheel.
    Tricycle,
}

impl VehicleModel {
    /// Every model.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in documents.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Place of the speed measurement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum SpeedMeasuredAt {
    /// Rear axle's centre.
    RearAxle,
    /// Steered front wheel: `v = v_front * cos(steering_true)`.
    SteeredWheel,
    /// One rear wheel, `lateral_m` to the left of the axle's centre.
    RearWheel {
        /// Position of the wheel along y of `base`, m.
        lateral_m: f64,
    },
}
