//! Error of the LiDAR's `y` that a speed measured beside the axle's middle may cause.
//!
//! An encoder `y_e` beside the middle shifts `y_off` by `y_e`, and all that shows of it is a
//! quadratic term of the steering's curve, `-y_e / L`: no motion distinguishes the two, and where
//! they cancel nothing shows at all. The variance is therefore by the probability of both: a robot
//! with every imperfection (`claim::compound`) may well have these two as well.

use crate::filter::prior::QUADRATIC_SIGMA_PER_RAD;
use crate::filter::relevance::Known;
use crate::filter::{Filter, QUADRATIC};
use crate::vehicle::{SpeedMeasuredAt, Vehicle};

/// Sigma of the distance from the axle's middle at which the speed is measured, where nobody stated
/// it, m.
pub const ENCODER_SIGMA_M: f64 = 0.05;
/// Share of a visible quadratic term that such an encoder may explain.
const ENCODER_SHARE: f64 = 0.4;
/// Sigmas of a quadratic term that a smaller one counts as. An estimate below differs with each new
/// local map, and made `y`'s sigma up to 20 % wider, or 10 % narrower, after a restart that had
/// lost no message. With 2 one of 20 such restarts still made it 8 % wider; with 3 none of ten
/// robots with an asymmetric steering was `converged` after three minutes of aisles, with 2.5 all
/// were.
const UNSEEN_SIGMAS: f64 = 2.5;
/// Part of it that no curve shows, m, chosen so that the claims of robots whose rear wheels are 1 %
/// too large and too small stay within 4 sigmas at any moment: that moves `y` by 4.8 mm in the
/// simulator, and was up to 4.7 sigmas without it. As one standard deviation it is 0.2 % to either
/// side on an axle of 0.8 m.
const UNEQUAL_WHEELS_SIGMA_M: f64 = 0.000_8;

/// Variance of the LiDAR's `y` that no motion shows, since the speed may be measured beside the axle's middle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EncoderVariance {
    /// Variance for the place where the speed is measured, m².
    pub place_m2: f64,
    /// Part of it that no driving removes, m²; the rest goes as the curve of the steering becomes
    /// known.
    pub undriven_place_m2: f64,
    /// Standard deviation for rear wheels of unequal size, m.
    pub unequal_wheels_sigma_m: f64,
}

impl EncoderVariance {
    /// The variance of a stored calibration, which no driving of a new session removes.
    pub fn undriven(variance_m2: f64) -> Self {
        Self {
            place_m2: variance_m2,
            undriven_place_m2: variance_m2,
            unequal_wheels_sigma_m: 0.0,
        }
    }

    /// All of it, m².
    pub fn total_m2(&self) -> f64 {
        self.place_m2 + self.unequal_wheels_sigma_m.powi(2)
    }

    /// The part of it that no driving removes, m².
    pub fn undriven_m2(&self) -> f64 {
        self.undriven_place_m2 + self.unequal_wheels_sigma_m.powi(2)
    }
}

impl Known {
    /// Variance that is added for this filter and its knowledge, on a robot that has every
    /// imperfection with this probability. A speed that is measured at the steered wheel, or beside
    /// the axle by a known distance, moves nothing.
    pub fn encoder_variance(
        &self,
        filter: &Filter,
        vehicle: &Vehicle,
        probability: f64,
    ) -> EncoderVariance {
        if vehicle.speed_measured_at != SpeedMeasuredAt::RearAxle {
            return EncoderVariance::default();
        }
        let variance = self.covariance[(QUADRATIC, QUADRATIC)];
        let unseen_square = UNSEEN_SIGMAS.powi(2) * variance;
        let is_seen = self.largest_quadratic_square > unseen_square;
        let seen_square = if is_seen {
            self.largest_quadratic_square
        } else {
            0.0
        };
        let told_square = seen_square.max(unseen_square) + variance;
        let hidden_m2 = filter.hidden_encoder_m2(vehicle.wheelbase_m) * probability;
        let [place_m2, undriven_place_m2] = [told_square, seen_square].map(|square| {
            let shown_m2 = (ENCODER_SHARE * vehicle.wheelbase_m).powi(2) * square;
            shown_m2.max(hidden_m2)
        });
        EncoderVariance {
            place_m2,
            undriven_place_m2,
            unequal_wheels_sigma_m: UNEQUAL_WHEELS_SIGMA_M,
        }
    }
}

impl Filter {
    /// Mean square of the distance from the axle's middle at which the speed may be measured, on a
    /// robot with every imperfection.
    fn hidden_encoder_m2(&self, wheelbase_m: f64) -> f64 {
        let covariance = self.parameter_covariance();
        let (encoder_m2, curve_m2) = (
            ENCODER_SIGMA_M.powi(2),
            (wheelbase_m * QUADRATIC_SIGMA_PER_RAD).powi(2),
        );
        let share = encoder_m2 / (encoder_m2 + curve_m2);
        let seen = self.values()[QUADRATIC].powi(2) + covariance[(QUADRATIC, QUADRATIC)];
        share * curve_m2 + (share * wheelbase_m).powi(2) * seen
    }
}
