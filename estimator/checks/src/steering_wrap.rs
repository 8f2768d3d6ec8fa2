//! Angles that run from 0 to a full turn.

use std::f64::consts::TAU;

/// Fewest angles on either side.
const SIDE_MIN: u32 = 20;
/// Most of the angles that may lie between, as a share.
const BETWEEN_MAX: f64 = 0.02;

/// Angles of a sensor, counted by where they lie in a turn.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    low: u32,
    between: u32,
    high: u32,
    outside: u32,
}

impl Counts {
    fn take(&mut self, angle: f64, turn: f64) {
        let share = angle / turn;
        let count = if !(-1e-6..=1.001).contains(&share) {
            &mut self.outside
        } else if share < 0.25 {
            &mut self.low
        } else if share > 0.75 {
            &mut self.high
        } else {
            &mut self.between
        };
        *count = count.saturating_add(1);
    }

    fn wraps(&self) -> bool {
        let all = f64::from(self.low) + f64::from(self.high);
        self.outside == 0
            && self.low.min(self.high) >= SIDE_MIN
            && f64::from(self.between) < BETWEEN_MAX * all
    }
}

/// Finds a turn that right angles come short of, in radians or degrees.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct SteeringWrap {
    radians: Counts,
    degrees: Counts,
    turn: Option<f64>,
}

impl SteeringWrap {
    /// Adds an angle; returns true if a turn was found just now.
    pub fn take(&mut self, angle: f64) -> bool {
        self.radians.take(angle, TAU);
        self.degrees.take(angle, 360.0);
        let turn = [(self.radians, TAU), (self.degrees, 360.0)];
        let found = turn.into_iter().find(|(counts, _)| counts.wraps());
        let before = self.turn.is_some();
        self.turn = self.turn.or(found.map(|(_, turn)| turn));
        self.turn.is_some() && !before
    }

    /// The angle without the turn.
    pub fn unwrapped(&self, angle: f64) -> f64 {
        match self.turn {
            Some(turn) if angle > 0.5 * turn => angle - turn,
            _ => angle,
        }
    }

    /// The turn, where one was found.
    pub fn turn(&self) -> Option<f64> {
        self.turn
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_turn_is_found_and_taken_off() {
        for (turn, unit) in [(TAU, 1.0), (360.0, 180.0 / std::f64::consts::PI)] {
            let mut wrap = SteeringWrap::default();
            for step in 0..500 {
                let angle = 0.5 * (f64::from(step) * 0.1).sin() * unit;
                wrap.take(angle.rem_euclid(turn));
            }
            assert_eq!(wrap.turn(), Some(turn));
            assert!((wrap.unwrapped(turn - 0.3) + 0.3).abs() < 1e-12);
        }
        let mut plain = SteeringWrap::default();
        for step in 0..500 {
            plain.take(0.5 * (f64::from(step) * 0.1).sin());
        }
        assert_eq!(plain.turn(), None);
    }
}
