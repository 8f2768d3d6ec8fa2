//! Which motions a robot has made, and which one is missing.

use serde::{Deserialize, Serialize};

/// Curvature below which driving counts as straight, 1/m (a radius of 20 m).
const STRAIGHT_MAX_PER_M: f64 = 0.05;
/// Distance in a bucket that counts as filled, m.
pub const FILLED_M: f64 = 3.0;

/// Distance driven in each kind of motion, m.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Excitation {
    /// Curving left.
    pub left_m: f64,
    /// Straight.
    pub straight_m: f64,
    /// Curving right.
    pub right_m: f64,
    /// Backwards, in any direction.
    pub reverse_m: f64,
    /// Change of speed and curvature, as metres driven while they change.
    pub changing_m: f64,
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

    /// Distance in all, m.
    pub fn total_m(&self) -> f64 {
        self.left_m + self.straight_m + self.right_m
    }

    /// The motion that would tell most about where the LiDAR sits, as an instruction.
    pub fn missing_turn(&self) -> &'static str {
        let (left, right) = (self.left_m >= FILLED_M, self.right_m >= FILLED_M);
        match (left, right, self.straight_m >= FILLED_M) {
            (false, false, _) => "one left and one right turn tighter than 8 m",
            (false, true, _) => "one left turn tighter than 8 m",
            (true, false, _) => "one right turn tighter than 8 m",
            (true, true, false) => "10 m straight ahead",
            (true, true, true) => "more turns to both sides",
        }
    }

    /// The motion that would tell most about directions, as an instruction.
    pub fn missing_straight(&self) -> &'static str {
        if self.straight_m < FILLED_M {
            "10 m straight ahead"
        } else {
            self.missing_turn()
        }
    }
}
