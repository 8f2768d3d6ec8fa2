//! The parameters of a calibration, and how well they are known.

use serde::{Deserialize, Serialize};
use strum::{EnumCount, EnumString, IntoStaticStr, VariantArray};

/// Parameter of the calibration, by its name in documents.
// The order of the variants is the order of every array of parameters.
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
    EnumString,
    IntoStaticStr,
    VariantArray,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = ParameterName))]
pub enum Parameter {
    /// `delta_off`: reading of the steering sensor when the wheel points straight ahead, rad.
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
    /// Delay of a motion in the wheel odometry against the LiDAR's, s.
    TimeOffset,
    /// True steering angle (less its offset) over the measured one.
    SteeringGain,
}

impl Parameter {
    /// All parameters, in order.
    pub const ALL: [Self; <Self as EnumCount>::COUNT] =
        match <Self as VariantArray>::VARIANTS.first_chunk() {
            Some(all) => *all,
            None => unreachable!(),
        };

    /// Returns its position in arrays of parameters.
    #[inline]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Returns the name in documents: `steering_offset`, `lidar_x` and so on.
    #[inline]
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Returns the unit of its value and sigma.
    #[inline]
    pub const fn unit(self) -> Unit {
        match self {
            Self::SteeringOffset | Self::LidarYaw => Unit::Radian,
            Self::LidarX | Self::LidarY | Self::Wheelbase => Unit::Metre,
            Self::TimeOffset => Unit::Second,
            Self::SpeedScale | Self::SteeringGain => Unit::One,
        }
    }
}

/// Unit of a parameter's value and sigma.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, IntoStaticStr,
)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Unit {
    /// Radian.
    #[serde(rename = "rad")]
    #[strum(serialize = "rad")]
    Radian,
    /// Metre.
    #[serde(rename = "m")]
    #[strum(serialize = "m")]
    Metre,
    /// Second.
    #[serde(rename = "s")]
    #[strum(serialize = "s")]
    Second,
    /// A plain ratio.
    #[serde(rename = "1")]
    #[strum(serialize = "1")]
    One,
}

impl Unit {
    /// Returns the name in documents.
    #[inline]
    pub fn symbol(self) -> &'static str {
        self.into()
    }
}

/// Status of a parameter's estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum ParameterStatus {
    /// Its sigma is inside its limit and confirmed by the repeatability of the data.
    Converged,
    /// Its sigma is not inside its limit yet.
    Learning,
    /// The motions so far carry no information about it.
    Unobservable,
    /// Held at its configured value, with its configured uncertainty.
    Fixed,
    /// The model does not include it.
    Off,
}

/// Numbers of messages since the session began.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Counts {
    /// Drive samples used.
    pub drive_samples: u64,
    /// Scans or LiDAR poses used.
    pub scans: u64,
    /// Scans that were unusable.
    pub scans_rejected: u64,
    /// Messages that came too late.
    pub late: u64,
    /// Messages that came twice.
    pub duplicates: u64,
}

/// Distance driven in each kind of motion, m.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Motions {
    /// Distance driven in curves to the left, m.
    pub left_m: f64,
    /// Distance driven straight, m.
    pub straight_m: f64,
    /// Distance driven in curves to the right, m.
    pub right_m: f64,
    /// Distance driven backwards, in any direction, m.
    pub reverse_m: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_and_json_name_a_parameter_alike() {
        for parameter in Parameter::ALL {
            let json = serde_json::to_value(parameter).unwrap();
            assert_eq!(json, parameter.name());
            assert_eq!(parameter.name().parse(), Ok(parameter));
            let unit = serde_json::to_value(parameter.unit()).unwrap();
            assert_eq!(unit, parameter.unit().symbol());
        }
        assert!("lidar_z".parse::<Parameter>().is_err());
    }

    #[test]
    fn a_parameter_stands_at_its_index() {
        for (index, parameter) in Parameter::ALL.into_iter().enumerate() {
            assert_eq!(parameter.index(), index);
        }
    }
}
