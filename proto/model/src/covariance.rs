//! The covariance of a calibration.

use serde::{Deserialize, Serialize};

use crate::parameter::Parameter;

/// Covariance of steering offset (rad), LiDAR x (m), LiDAR y (m) and LiDAR yaw (rad), in this order,
/// by rows. The square roots of its diagonal are their standard deviations.
// The comment is what OpenAPI says.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(transparent)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(value_type = Vec<Vec<f64>>))]
pub struct CalibrationCovariance([[f64; 4]; 4]);

impl CalibrationCovariance {
    /// Parameters of its rows and columns.
    pub const OF: [Parameter; 4] = [
        Parameter::SteeringOffset,
        Parameter::LidarX,
        Parameter::LidarY,
        Parameter::LidarYaw,
    ];

    /// Makes a covariance from the entry that `of` returns for each row and column.
    pub fn from_fn(of: impl Fn(Parameter, Parameter) -> f64) -> Self {
        Self(Self::OF.map(|row| Self::OF.map(|column| of(row, column))))
    }

    /// Returns its rows, in the order of [`Self::OF`].
    pub const fn rows(&self) -> &[[f64; 4]; 4] {
        &self.0
    }

    /// True if every entry is finite.
    pub fn is_finite(&self) -> bool {
        self.0.as_flattened().iter().all(|entry| entry.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_has_its_rows() {
        let covariance = CalibrationCovariance::from_fn(|row, column| {
            (10 * row.index() + column.index()) as f64
        });
        let json = serde_json::to_value(covariance).unwrap();
        assert_eq!(json[1][2], 12.0);
        assert_eq!(json[3][0], 30.0);
        assert_eq!(
            serde_json::from_value::<CalibrationCovariance>(json).unwrap(),
            covariance
        );
        for other in ["[[1, 2], [3, 4]]", "[1, 2, 3, 4]"] {
            assert!(serde_json::from_str::<CalibrationCovariance>(other).is_err());
        }
    }

    #[test]
    fn one_entry_that_is_no_number_is_found() {
        let all_but = |bad: f64| {
            CalibrationCovariance::from_fn(|row, column| {
                if (row, column) == (Parameter::LidarYaw, Parameter::LidarX) {
                    bad
                } else {
                    1.0
                }
            })
        };
        assert!(all_but(0.0).is_finite());
        assert!(!all_but(f64::NAN).is_finite());
    }
}
