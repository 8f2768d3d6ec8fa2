//! Checks of a message's fields, and the refusal that names one.

use fleetcal_model::RobotTime;
use thiserror::Error;

/// Refusal of a message: the field, its value and the accepted values.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{field}: got {value}, expected {accepted}")]
pub struct FieldRefused {
    /// Name of the field, as it stands in the ROS message.
    pub field: &'static str,
    /// Refused value.
    pub value: String,
    /// Accepted values, in words.
    pub accepted: &'static str,
}

impl FieldRefused {
    /// Refusal of a field with its value and the accepted values, in words.
    pub fn new(field: &'static str, value: impl std::fmt::Display, accepted: &'static str) -> Self {
        Self {
            field,
            value: value.to_string(),
            accepted,
        }
    }
}

/// Accepts a stamp after 1970.
///
/// # Errors
/// Names the stamp, in ns.
pub fn check_stamp(stamp: RobotTime) -> Result<(), FieldRefused> {
    if stamp.0 > 0 {
        Ok(())
    } else {
        Err(FieldRefused::new(
            "header.stamp",
            format!("{} ns", stamp.0),
            "a time after 1970",
        ))
    }
}

/// Accepts a finite number of at most `limit` either way.
///
/// # Errors
/// Names the field and its value.
pub fn check_finite(field: &'static str, value: f64, limit: f64) -> Result<(), FieldRefused> {
    if value.is_finite() && value.abs() <= limit {
        Ok(())
    } else {
        Err(FieldRefused::new(
            field,
            value,
            "a finite number of physical size",
        ))
    }
}
