//! Beams of an imperfect scanner: their hits and readings.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::imperfections::{INCIDENCE_REFERENCE_RAD, ScannerImperfections};
use super::random::{Stream, stream};
use super::ray::Met;

/// Height of the LiDAR above the floor, m.
const HEIGHT_M: f64 = 0.2;
/// Neighbours whose ranges differ by more than this are on two surfaces, m.
const EDGE_M: f64 = 0.15;

/// Direction of a beam of a tilted scanner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Aim {
    /// Turn of its heading over the floor by the tilt, rad.
    pub turned_rad: f64,
    /// Length over the floor of each metre of the beam.
    horizontal: f64,
    /// Descent on each metre of the beam; negative for up.
    down: f64,
}

impl Aim {
    /// Returns the hit along the beam itself: the obstacle `met` over the floor, or the floor
    /// before it.
    pub fn along(self, met: Met) -> Met {
        let floor_m = HEIGHT_M / self.down;
        let range_m = met.range_m / self.horizontal;
        if self.down > 0.0 && floor_m < range_m {
            return Met {
                range_m: floor_m,
                cos_incidence: self.down,
            };
        }
        Met { range_m, ..met }
    }
}

/// Beams with their imperfections.
#[derive(Debug)]
pub(super) struct Beams {
    imperfections: ScannerImperfections,
    range_scale: f64,
    random: ChaCha8Rng,
}

impl Beams {
    pub fn new(imperfections: ScannerImperfections, range_scale: f64, seed: u64) -> Self {
        Self {
            imperfections,
            range_scale,
            random: stream(seed, Stream::MixedPixels),
        }
    }

    /// Returns the direction of the beam at an angle of the LiDAR's frame. Its part along the
    /// tilt's direction, `p = cos(angle - direction)`, becomes `p·cos(tilt)` over the floor and
    /// `p·sin(tilt)` down; the part across it, `q`, stays.
    pub fn aim(&self, angle_rad: f64) -> Aim {
        let ScannerImperfections {
            tilt_rad,
            tilt_direction_rad,
            ..
        } = self.imperfections;
        if tilt_rad == 0.0 {
            return Aim {
                turned_rad: 0.0,
                horizontal: 1.0,
                down: 0.0,
            };
        }
        let (q, p) = (angle_rad - tilt_direction_rad).sin_cos();
        let (sin, cos) = tilt_rad.sin_cos();
        Aim {
            turned_rad: (p * q * (1.0 - cos)).atan2(p * p * cos + q * q),
            horizontal: (p * cos).hypot(q),
            down: p * sin,
        }
    }

    /// Mixes the ranges of beams at the edge of two surfaces.
    pub fn mix(&mut self, met: &mut [Met]) {
        let probability = self.imperfections.mixed_pixels;
        if probability <= 0.0 {
            return;
        }
        for beam in 1..met.len() {
            let (here, next) = (met[beam - 1].range_m, met[beam].range_m);
            let edge = (next - here).is_finite() && (next - here).abs() > EDGE_M;
            if edge && self.random.random::<f64>() < probability {
                met[beam - 1].range_m = here + self.random.random::<f64>() * (next - here);
            }
        }
    }

    /// Returns the range of a beam without noise, m: `(1 + scale)·r + bias + incidence_bias·(1 -
    /// cos(incidence))/(1 - cos(60°))`.
    pub fn shown_m(&self, met: &Met) -> f64 {
        let incidence = (1.0 - met.cos_incidence) / (1.0 - INCIDENCE_REFERENCE_RAD.cos());
        (1.0 + self.range_scale) * met.range_m
            + self.imperfections.range_bias_m
            + self.imperfections.incidence_bias_m * incidence
    }
}
