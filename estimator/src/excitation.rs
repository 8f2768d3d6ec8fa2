//! Motions that a robot has made. Information decides what is known of it; these explain that, and
//! show where all turns went to one side.

use serde::{Deserialize, Serialize};

use crate::steered_way::SteeredWay;

/// Curvature below which driving counts as straight, 1/m (a radius of 20 m).
const STRAIGHT_MAX_PER_M: f64 = 0.05;

/// Largest share to the other side of turns that are to one: a vehicle that follows a path
/// overshoots.
const ONE_SIDED_SHARE_MAX: f64 = 0.1;
/// Smallest share to the other side of turns that are to both.
const TWO_SIDED_SHARE_MIN: f64 = 0.2;

/// Smallest share of the way that has to be straight to show how a vehicle's axle rolls.
const STRAIGHT_SHARE_MIN: f64 = 0.1;
/// Way before which it is open whether a vehicle circles, m.
const CIRCLING_FROM_M: f64 = 10.0;

/// Distance driven in each kind of motion, m.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Excitation {
    /// Curving left.
    pub left_m: f64,
    /// Straight.
    pub straight_m: f64,
    /// Curving right.
    pub right_m: f64,
    /// Backwards, in any direction.
    pub reverse_m: f64,
    /// Measured steering angles that were driven.
    #[serde(default)]
    pub steered: SteeredWay,
}

impl Excitation {
    /// Adds a stretch: its signed distance and its turn.
    pub fn add(&mut self, distance_m: f64, turn_rad: f64) {
        let length_m = distance_m.abs();
        if length_m < 1e-9 {
            return;
        }
        // Left is where the vehicle curves to, whichever way it rolls.
        let curvature = turn_rad / distance_m;
        if curvature > STRAIGHT_MAX_PER_M {
            self.left_m += length_m;
        } else if curvature < -STRAIGHT_MAX_PER_M {
            self.right_m += length_m;
        } else {
            self.straight_m += length_m;
        }
        if distance_m < 0.0 {
            self.reverse_m += length_m;
        }
    }

    /// Degree to which the turns went to one side alone: 1 where nine tenths of their way did or
    /// there was none, 0 where a fifth or more went to the other side.
    pub fn one_sidedness(&self) -> f64 {
        let (less_m, turning_m) = (self.left_m.min(self.right_m), self.left_m + self.right_m);
        if turning_m <= 0.0 {
            return 1.0;
        }
        let missing_share = TWO_SIDED_SHARE_MIN - less_m / turning_m;
        (missing_share / (TWO_SIDED_SHARE_MIN - ONE_SIDED_SHARE_MAX)).clamp(0.0, 1.0)
    }

    /// Degree to which it did nothing but turn to one side: 1 where it never drove straight, 0
    /// where a tenth of its way was straight, a fifth of its turns went to the other side, or the
    /// way is too short to decide.
    pub fn circling(&self) -> f64 {
        let way_m = self.left_m + self.straight_m + self.right_m;
        if way_m < CIRCLING_FROM_M {
            return 0.0;
        }
        let missing_share = STRAIGHT_SHARE_MIN - self.straight_m / way_m;
        self.one_sidedness() * (missing_share / STRAIGHT_SHARE_MIN).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_drives_straight_for_a_tenth_of_the_way_does_not_circle() {
        let mut driven = Excitation::default();
        driven.add(9.0, -4.5);
        assert!(driven.circling() < 1e-12, "too short to tell");
        driven.add(81.0, -40.5);
        assert!((driven.circling() - 1.0).abs() < 1e-12);
        driven.add(5.0, 0.0);
        assert!((0.3..0.6).contains(&driven.circling()));
        driven.add(5.0, 0.0);
        assert!(driven.circling() < 1e-12);
    }

    #[test]
    fn turns_are_to_one_side_until_a_fifth_of_them_went_to_the_other() {
        let mut driven = Excitation::default();
        assert!((driven.one_sidedness() - 1.0).abs() < 1e-12);
        driven.add(80.0, 16.0);
        driven.add(50.0, 0.0);
        driven.add(5.0, -1.0);
        assert!((driven.one_sidedness() - 1.0).abs() < 1e-12);
        driven.add(-8.0, 1.6);
        assert!((0.2..0.9).contains(&driven.one_sidedness()));
        driven.add(7.0, -1.4);
        assert!(driven.one_sidedness() < 1e-12);
    }
}
