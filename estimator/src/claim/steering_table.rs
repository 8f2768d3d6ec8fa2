//! Steering table of a claim: the true steering angle at measured angles, with the uncertainty of the curve.
//!
//! A point's variance is `J C J'` with the derivatives `J` of the true angle by the parameters and the claim's
//! covariance `C`, in which offset, gain and curve go together; what the published sigma of the offset has
//! beside that covariance shifts all points alike.

use super::Claim;
use crate::estimate::{
    Parameter, ParameterEstimate, Status, SteeringPoint, SteeringTable, SteeringTableStatus,
};
use crate::filter::{DRIVE_PARAMETER, Values, drive_parameters};
use crate::steered_way::SteeringRange;
use crate::vehicle::true_steering;

/// Largest angle between two points, rad (4 degrees): at typical terms of the curve a straight line between them
/// is less than 0.02 degrees off up to 45 degrees.
const PART_MAX_RAD: f64 = 0.07;
/// Most equal parts of a side, each with a point at its end: enough for 80 degrees, and a steering that turns
/// farther has no linkage and no curve.
const PARTS_MAX: f64 = 20.0;
/// Least angle of a side that has points, rad: who drives straight ahead steers two degrees.
const SIDE_MIN_RAD: f64 = 0.035;

/// Need where the configuration fixes the offset: it is known no better than it was entered.
const OFFSET_FIXED: &str = "a steering offset that is estimated: the configuration fixes it";

/// Side to which a robot steers.
#[derive(Debug, Clone, Copy)]
struct Side {
    /// Its end on the right, rad.
    from_rad: f64,
    /// Its end on the left, rad.
    to_rad: f64,
}

impl Side {
    fn is_driven(self) -> bool {
        self.to_rad - self.from_rad >= SIDE_MIN_RAD
    }

    fn angles(self) -> impl Iterator<Item = f64> {
        let width_rad = self.to_rad - self.from_rad;
        let number = (width_rad / PART_MAX_RAD).ceil().clamp(1.0, PARTS_MAX);
        let parts = (0..=number as u32).filter(move |_| self.is_driven());
        parts.map(move |part| {
            let share = f64::from(part) / number;
            share * self.to_rad + (1.0 - share) * self.from_rad
        })
    }
}

impl Claim {
    /// The table at the angles that were driven, of a steering whose offset is estimated so. It is
    /// `converged` where every sigma is inside this limit.
    pub fn steering_table(
        &self,
        offset: &ParameterEstimate,
        driven: Option<SteeringRange>,
        sigma_limit_rad: f64,
    ) -> SteeringTable {
        if offset.status != Status::Converged {
            let needs = match offset.status {
                Status::Fixed => Some(OFFSET_FIXED.to_owned()),
                _ => offset.needs.clone(),
            };
            return SteeringTable::not_known(needs);
        }
        let zero_rad = offset.value;
        let driven = driven.unwrap_or(SteeringRange {
            rightmost_rad: zero_rad,
            leftmost_rad: zero_rad,
        });
        let right = Side {
            from_rad: driven.rightmost_rad,
            to_rad: driven.leftmost_rad.min(zero_rad),
        };
        let left = Side {
            from_rad: driven.rightmost_rad.max(zero_rad),
            to_rad: driven.leftmost_rad,
        };
        let needs = match (left.is_driven(), right.is_driven()) {
            (true, true) => None,
            (false, true) => Some("turns to the left"),
            (true, false) => Some("turns to the right"),
            (false, false) => Some("turns to both sides"),
        };
        // The zero is of both sides.
        let mut angles: Vec<f64> = right.angles().chain(left.angles()).collect();
        angles.dedup();
        let points: Vec<SteeringPoint> = angles
            .into_iter()
            .map(|measured_rad| self.steering_point(measured_rad))
            .collect();
        let is_sharp = points
            .iter()
            .all(|point| point.sigma_rad <= sigma_limit_rad);
        let status = match (points.is_empty(), needs.is_none() && is_sharp) {
            (true, _) => SteeringTableStatus::NotKnown,
            (false, false) => SteeringTableStatus::Informative,
            (false, true) => SteeringTableStatus::Converged,
        };
        SteeringTable {
            status,
            needs: needs.map(str::to_owned),
            points,
        }
    }

    fn steering_point(&self, measured_rad: f64) -> SteeringPoint {
        let (true_rad, by_drive) = true_steering(measured_rad, &drive_parameters(self.values()));
        let mut by = Values::zeros();
        for (parameter, derivative) in DRIVE_PARAMETER.into_iter().zip(by_drive) {
            by[parameter] = derivative;
        }
        let offset = Parameter::SteeringOffset;
        let covariance = self.covariance();
        let beside_rad2 = self.sigma(offset).powi(2) - covariance[(offset.index(), offset.index())];
        let variance = (covariance * by).dot(&by) + by[offset.index()].powi(2) * beside_rad2;
        SteeringPoint {
            measured_rad,
            true_rad,
            sigma_rad: variance.max(0.0).sqrt(),
        }
    }
}
