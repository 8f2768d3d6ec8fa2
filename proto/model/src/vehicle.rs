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
    /// Steered axle or wheel behind the fixed axle, as of forklifts; speed measured at the fixed
    /// axle. An angle is positive where the wheel is turned to the left, counter-clockwise from
    /// above: it turns the vehicle to the right.
    RearSteered,
}

impl VehicleModel {
    /// Every model.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// Returns its name in configurations and documents.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Returns the usual place of its speed measurement.
    pub const fn speed_measured_at(self) -> SpeedMeasuredAt {
        match self {
            Self::Bicycle | Self::RearSteered => SpeedMeasuredAt::RearAxle,
            Self::Tricycle => SpeedMeasuredAt::SteeredWheel,
        }
    }

    /// Returns 1 where the steered axle is before the fixed one, -1 where it is behind: the yaw rate is
    /// that sign times `v tan(steering) / wheelbase`.
    pub const fn steered_ahead(self) -> f64 {
        match self {
            Self::Bicycle | Self::Tricycle => 1.0,
            Self::RearSteered => -1.0,
        }
    }
}

/// Place of the speed measurement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum SpeedMeasuredAt {
    /// Fixed axle's centre: of the rear axle, or of the front axle of a rear-steered vehicle.
    RearAxle,
    /// Steered wheel: `v = v_wheel * cos(steering_true)`.
    SteeredWheel,
    /// One wheel of the fixed axle, `lateral_m` to the left of the axle's centre.
    RearWheel {
        /// Position of the wheel along y of `base`, m.
        lateral_m: f64,
    },
}
