//! Measured steering angles that a robot has driven.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Way at an angle, or farther to its side, from which on the angle was driven, m: a reading that was wrong
/// for a moment is no angle of the robot.
const DRIVEN_M: f32 = 0.5;

/// Way of the steered wheel in each degree of the measured steering angle, m, as far as it counts.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SteeredWay(BTreeMap<i8, f32>);

/// Range of measured steering angles, rad, left positive.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SteeringRange {
    /// End on the right.
    pub rightmost_rad: f64,
    /// End on the left.
    pub leftmost_rad: f64,
}

impl SteeringRange {
    /// The range from the farther end on the right to the farther one on the left.
    #[must_use]
    pub fn joined(self, other: Self) -> Self {
        Self {
            rightmost_rad: self.rightmost_rad.min(other.rightmost_rad),
            leftmost_rad: self.leftmost_rad.max(other.leftmost_rad),
        }
    }
}

impl SteeredWay {
    /// Adds a way of the steered wheel, m, of either sign, at a measured angle.
    pub fn add(&mut self, distance_m: f64, measured_rad: f64) {
        let way_m = self.0.entry(degree_of(measured_rad)).or_default();
        *way_m = (*way_m + distance_m.abs() as f32).min(DRIVEN_M);
    }

    /// Range between the farthest whole degrees that were driven to either side; `None` before there are
    /// two.
    pub fn range(&self) -> Option<SteeringRange> {
        let rightmost_deg = f64::from(first_driven(self.0.iter())?) + 1.0;
        let leftmost_deg = f64::from(first_driven(self.0.iter().rev())?);
        (rightmost_deg < leftmost_deg).then(|| SteeringRange {
            rightmost_rad: rightmost_deg.to_radians(),
            leftmost_rad: leftmost_deg.to_radians(),
        })
    }
}

/// Whole degree at or to the right of an angle.
fn degree_of(measured_rad: f64) -> i8 {
    let degree = measured_rad.to_degrees().floor();
    degree.clamp(f64::from(i8::MIN), f64::from(i8::MAX)) as i8
}

/// First of the degrees up to which the robot has driven far enough.
fn first_driven<'a>(mut degrees: impl Iterator<Item = (&'a i8, &'a f32)>) -> Option<i8> {
    let mut way_m = 0.0;
    let far_enough = degrees.find(|(_, more_m)| {
        way_m += **more_m;
        way_m >= DRIVEN_M
    });
    far_enough.map(|(degree, _)| *degree)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_has_only_angles_that_were_driven() {
        let mut steered = SteeredWay::default();
        assert_eq!(steered.range(), None);
        let mut drive = |distance_m: f64, deg: f64| {
            steered.add(distance_m, deg.to_radians());
            steered.range()
        };
        assert_eq!(drive(4.0, -10.5), None);
        // Backwards is driven, too, and one reading beyond is not.
        drive(-0.3, 20.5);
        drive(0.1, 80.0);
        let range = drive(-0.3, 20.5).unwrap();
        assert!((range.rightmost_rad - (-10f64).to_radians()).abs() < 1e-12);
        assert!((range.leftmost_rad - 20f64.to_radians()).abs() < 1e-12);
    }

    #[test]
    fn it_is_stored_in_few_bytes() {
        let mut steered = SteeredWay::default();
        for deg in -900..900 {
            steered.add(3.0, (f64::from(deg) / 10.0).to_radians());
        }
        let text = serde_json::to_string(&steered).unwrap();
        assert!(text.len() < 2_000, "{}", text.len());
        assert_eq!(serde_json::from_str::<SteeredWay>(&text).unwrap(), steered);
    }
}
