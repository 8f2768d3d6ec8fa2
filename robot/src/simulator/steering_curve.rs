//! The steered wheel's angle by the angle that the sensor shows.

use super::imperfections::{CURVE_REFERENCE_RAD, VehicleImperfections};

/// Angle from which the curve continues straight, rad: 45°.
const STRAIGHT_FROM_RAD: f64 = std::f64::consts::FRAC_PI_4;
/// Steps of Newton's iteration; an increasing curve needs five for the last bit.
const NEWTON_STEPS: usize = 12;

/// Steering curve `steering = (gain + asymmetry·sign(u))·u + quadratic·u² + cubic·u³`, with `u` the
/// shown angle less its offset, rad. Beyond 45° it continues with the slope it has there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SteeringCurve {
    gain: f64,
    asymmetry: f64,
    /// Quadratic coefficient, 1/rad.
    quadratic: f64,
    /// Cubic coefficient, 1/rad².
    cubic: f64,
}

impl SteeringCurve {
    /// Makes the curve of a vehicle whose steering has this gain.
    pub fn new(steering_gain: f64, imperfections: &VehicleImperfections) -> Self {
        Self {
            gain: steering_gain * (1.0 + imperfections.steering_gain),
            asymmetry: imperfections.steering_asymmetry,
            quadratic: imperfections.steering_quadratic_rad / CURVE_REFERENCE_RAD.powi(2),
            cubic: imperfections.steering_cubic_rad / CURVE_REFERENCE_RAD.powi(3),
        }
    }

    /// Returns its gain at straight ahead, without the asymmetry.
    pub fn gain(&self) -> f64 {
        self.gain
    }

    /// Returns the true angle of the wheel for the shown angle less its offset, rad.
    pub fn wheel_rad(&self, shown_rad: f64) -> f64 {
        let bent_rad = shown_rad.clamp(-STRAIGHT_FROM_RAD, STRAIGHT_FROM_RAD);
        let straight_rad = shown_rad - bent_rad;
        let polynomial_rad = bent_rad * bent_rad * (self.quadratic + self.cubic * bent_rad);
        let slope = self.bend_slope(bent_rad);
        self.gain * shown_rad
            + (self.asymmetry * shown_rad.abs() + polynomial_rad + slope * straight_rad)
    }

    /// Returns the shown angle less its offset for a true angle of the wheel, rad.
    pub fn shown_rad(&self, wheel_rad: f64) -> f64 {
        let mut shown_rad = wheel_rad / self.gain;
        if self.is_straight() {
            return shown_rad;
        }
        for _ in 0..NEWTON_STEPS {
            let off_rad = self.wheel_rad(shown_rad) - wheel_rad;
            shown_rad -= off_rad / self.slope(shown_rad);
        }
        shown_rad
    }

    /// Returns the smallest slope anywhere: above 0 the curve can be inverted. The slope is a
    /// parabola on each side, so its least value is at an end or at its vertex.
    pub fn least_slope(&self) -> f64 {
        let vertex_rad = -self.quadratic / (3.0 * self.cubic);
        let vertex_rad = if vertex_rad.is_finite() {
            vertex_rad
        } else {
            0.0
        };
        let inside = vertex_rad.clamp(-STRAIGHT_FROM_RAD, STRAIGHT_FROM_RAD);
        [-STRAIGHT_FROM_RAD, -0.0, 0.0, inside, STRAIGHT_FROM_RAD]
            .map(|shown_rad| self.slope(shown_rad))
            .into_iter()
            .fold(f64::INFINITY, f64::min)
    }

    fn is_straight(&self) -> bool {
        self.asymmetry == 0.0 && self.quadratic == 0.0 && self.cubic == 0.0
    }

    fn slope(&self, shown_rad: f64) -> f64 {
        let bent_rad = shown_rad.clamp(-STRAIGHT_FROM_RAD, STRAIGHT_FROM_RAD);
        self.gain + self.asymmetry * 1f64.copysign(shown_rad) + self.bend_slope(bent_rad)
    }

    /// Returns the slope of the quadratic and cubic terms.
    fn bend_slope(&self, bent_rad: f64) -> f64 {
        bent_rad * (2.0 * self.quadratic + 3.0 * self.cubic * bent_rad)
    }
}
