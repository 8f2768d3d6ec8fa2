//! The streams that a robot sends.

use serde::{Deserialize, Serialize};
use strum::{EnumCount, IntoStaticStr, VariantArray};

/// A stream that a robot sends.
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
    EnumCount,
    IntoStaticStr,
    VariantArray,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Stream {
    /// Measured speed and steering.
    WheelOdometry,
    /// Measured steering alone, of a robot whose speed comes on a topic of its own.
    Steering,
    /// Measured speed alone.
    Speed,
    /// Scans.
    Scan,
    /// Poses of the LiDAR, estimated on the robot.
    LidarOdometry,
    /// Notes of people and tools.
    Event,
}

impl Stream {
    /// All streams, in order.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;
    /// Number of streams.
    pub const COUNT: usize = <Self as EnumCount>::COUNT;

    /// Returns its position in [`Self::ALL`].
    #[inline]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// True for the streams of the wheel odometry.
    #[inline]
    pub const fn is_wheel_odometry(self) -> bool {
        matches!(self, Self::WheelOdometry | Self::Steering | Self::Speed)
    }

    /// Returns the name in keys and documents: `wheel_odometry`, `lidar_odometry` and so on.
    #[inline]
    pub fn name(self) -> &'static str {
        self.into()
    }
}
