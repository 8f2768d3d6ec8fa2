//! Limits of a robot's own on any calibration, whoever signed it.

use fleetcal_proto::calibration::CalibrationValues;
use serde::Deserialize;
use thiserror::Error;

/// Lowest and highest accepted value, both included. In files it is `[lowest, highest]`.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(try_from = "[f64; 2]")]
pub struct Range {
    lowest: f64,
    highest: f64,
}

/// Reason for which two numbers are not a range.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("range is [{lowest}, {highest}], expected two finite numbers, the lower one first")]
pub struct RangeRefused {
    lowest: f64,
    highest: f64,
}

impl Range {
    /// Makes the range from `lowest` to `highest`.
    ///
    /// # Errors
    /// One is not finite, or they are in the wrong order.
    pub fn new(lowest: f64, highest: f64) -> Result<Self, RangeRefused> {
        if lowest.is_finite() && highest.is_finite() && lowest <= highest {
            return Ok(Self { lowest, highest });
        }
        Err(RangeRefused { lowest, highest })
    }

    /// Makes the range from `middle - most` to `middle + most`.
    const fn around(middle: f64, most: f64) -> Self {
        Self {
            lowest: middle - most,
            highest: middle + most,
        }
    }

    fn holds(self, value: f64) -> bool {
        (self.lowest..=self.highest).contains(&value)
    }
}

impl TryFrom<[f64; 2]> for Range {
    type Error = RangeRefused;

    fn try_from([lowest, highest]: [f64; 2]) -> Result<Self, Self::Error> {
        Self::new(lowest, highest)
    }
}

/// Limits of each value under its name on the wire. Keys that a file leaves out keep their
/// defaults.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Steering offset, rad; 15° to either side by default.
    pub steering_offset_rad: Range,
    /// LiDAR's x, m; from 2 m behind the rear axle to 6 m ahead of it by default.
    pub lidar_x_m: Range,
    /// LiDAR's y, m; 1.5 m to either side by default.
    pub lidar_y_m: Range,
    /// LiDAR's heading, rad; any direction by default.
    pub lidar_yaw_rad: Range,
    /// Speed scale; 0.8 to 1.25 by default.
    pub speed_scale: Range,
    /// Wheelbase, m; 0.1 m to 10 m by default.
    pub wheelbase_m: Range,
    /// Steering gain; 0.5 to 2 by default.
    pub steering_gain: Range,
    /// Time offset, s; half a second to either side by default.
    pub time_offset_s: Range,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            steering_offset_rad: Range::around(0.0, 15.0_f64.to_radians()),
            lidar_x_m: Range::around(2.0, 4.0),
            lidar_y_m: Range::around(0.0, 1.5),
            lidar_yaw_rad: Range::around(0.0, std::f64::consts::PI),
            speed_scale: Range::around(1.025, 0.225),
            wheelbase_m: Range::around(5.05, 4.95),
            steering_gain: Range::around(1.25, 0.75),
            time_offset_s: Range::around(0.0, 0.5),
        }
    }
}

/// A value outside this robot's limits.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("values.{field}: got {value}, expected {} to {} on this robot", range.lowest, range.highest)]
pub struct OutsideLimits {
    /// Its name on the wire.
    pub field: &'static str,
    /// The value.
    pub value: f64,
    /// Accepted range.
    pub range: Range,
}

impl Limits {
    /// Makes the default limits, with the mount within `most_m` and `most_rad` of its nominal pose.
    pub fn around_mount(x_m: f64, y_m: f64, yaw_rad: f64, most_m: f64, most_rad: f64) -> Self {
        Self {
            lidar_x_m: Range::around(x_m, most_m),
            lidar_y_m: Range::around(y_m, most_m),
            lidar_yaw_rad: Range::around(yaw_rad, most_rad),
            ..Self::default()
        }
    }

    /// Checks every present value.
    ///
    /// # Errors
    /// The first value outside its limits.
    pub fn check(&self, values: &CalibrationValues) -> Result<(), OutsideLimits> {
        let refused = values.fields().find_map(|(field, value)| {
            let range = self.of(field)?;
            (!range.holds(value)).then_some(OutsideLimits {
                field,
                value,
                range,
            })
        });
        refused.map_or(Ok(()), Err)
    }

    fn of(&self, field: &str) -> Option<Range> {
        match field {
            "steering_offset_rad" => Some(self.steering_offset_rad),
            "lidar_x_m" => Some(self.lidar_x_m),
            "lidar_y_m" => Some(self.lidar_y_m),
            "lidar_yaw_rad" => Some(self.lidar_yaw_rad),
            "speed_scale" => Some(self.speed_scale),
            "wheelbase_m" => Some(self.wheelbase_m),
            "steering_gain" => Some(self.steering_gain),
            "time_offset_s" => Some(self.time_offset_s),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values() -> CalibrationValues {
        CalibrationValues {
            steering_offset_rad: 0.05,
            lidar_x_m: 0.434,
            lidar_y_m: 0.0,
            lidar_yaw_rad: 3.0,
            speed_scale: Some(1.0),
            wheelbase_m: Some(1.2),
            steering_gain: Some(1.0),
            time_offset_s: Some(-0.05),
        }
    }

    #[test]
    fn every_value_of_the_wire_has_a_limit() {
        let limits = Limits::default();
        let mut fields = values().fields().peekable();
        assert!(fields.peek().is_some());
        for (field, _) in fields {
            assert!(limits.of(field).is_some(), "{field}");
        }
        limits.check(&values()).unwrap();
    }

    #[test]
    #[expect(clippy::too_many_lines, reason = "one case for each value")]
    fn a_value_outside_is_named_with_what_is_accepted() {
        let cases = [
            (
                CalibrationValues {
                    steering_offset_rad: 0.27,
                    ..values()
                },
                "steering_offset_rad: got 0.27",
            ),
            (
                CalibrationValues {
                    lidar_x_m: -2.5,
                    ..values()
                },
                "lidar_x_m: got -2.5",
            ),
            (
                CalibrationValues {
                    lidar_y_m: 1.6,
                    ..values()
                },
                "lidar_y_m: got 1.6",
            ),
            (
                CalibrationValues {
                    lidar_yaw_rad: 3.2,
                    ..values()
                },
                "lidar_yaw_rad: got 3.2",
            ),
            (
                CalibrationValues {
                    speed_scale: Some(0.7),
                    ..values()
                },
                "speed_scale: got 0.7",
            ),
            (
                CalibrationValues {
                    wheelbase_m: Some(0.0),
                    ..values()
                },
                "wheelbase_m: got 0",
            ),
            (
                CalibrationValues {
                    steering_gain: Some(3.0),
                    ..values()
                },
                "steering_gain: got 3",
            ),
            (
                CalibrationValues {
                    time_offset_s: Some(1.0),
                    ..values()
                },
                "time_offset_s: got 1",
            ),
            (
                CalibrationValues {
                    steering_offset_rad: f64::NAN,
                    ..values()
                },
                "steering_offset_rad: got NaN",
            ),
        ];
        for (values, wanted) in cases {
            let sentence = Limits::default().check(&values).unwrap_err().to_string();
            assert!(
                sentence.contains(wanted) && sentence.contains("on this robot"),
                "{sentence}"
            );
        }
    }

    #[test]
    fn ranges_are_two_finite_numbers_in_order() {
        for (lowest, highest) in [(1.0, 0.0), (f64::NAN, 1.0), (0.0, f64::INFINITY)] {
            assert!(Range::new(lowest, highest).is_err());
        }
        assert!(Range::new(0.0, 0.0).unwrap().holds(0.0));
    }
}
