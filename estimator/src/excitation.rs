//! Which motions a robot has made. It feeds no decision: information decides, this explains.

use serde::{Deserialize, Serialize};

/// Curvature below which driving counts as straight, 1/m (a radius of 20 m).
const STRAIGHT_MAX_PER_M: f64 = 0.05;

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
}
