//! The present estimate beside a proposal: whether what is proposed still holds.

use std::fmt;

use fleetcal_proto::calibration::CalibrationValues;

use super::revision::{Origin, Revision};
use super::values::{difference, four};

/// Farther than so many sigmas from the present estimate, a proposal is outdated.
const OUTDATED_SIGMAS: f64 = 3.0;
/// A proposal is refreshed at most this often, ns: whoever reads it can finish reading.
pub(super) const REFRESH_EVERY_NS: i64 = 60 * 1_000_000_000;

/// What the estimator says of a robot at this moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Present {
    /// Nothing that a proposal could be held against.
    Unknown,
    /// Somebody has reported a reassembly, and nothing is known again since.
    Reassembled,
    /// The vehicle is no longer the one that was calibrated, and its values are not known yet.
    VehicleChanged,
    /// These values.
    Known {
        /// The values.
        values: CalibrationValues,
        /// Their standard deviations.
        sigmas: CalibrationValues,
    },
}

/// Why a proposal does not hold any more.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outdated {
    /// The robot was reassembled, and its calibration is not known again yet.
    Reassembled,
    /// The vehicle is no longer the one that was calibrated.
    VehicleChanged,
    /// The present estimate is too far from it.
    Moved {
        /// The value that is farthest from the proposal, in sigmas.
        name: &'static str,
        /// Present estimate less proposal, in `unit`.
        by: f64,
        /// Degrees or millimetres.
        unit: &'static str,
        /// How many sigmas that is.
        sigmas: f64,
    },
}

impl fmt::Display for Outdated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Reassembled => f.write_str(
                "the robot was reassembled since, and its calibration is not known again yet",
            ),
            Self::VehicleChanged => {
                f.write_str("the vehicle is no longer the one that was calibrated")
            }
            Self::Moved {
                name,
                by,
                unit,
                sigmas,
            } => write!(
                f,
                "the present estimate differs from the proposal: {name} by {by:+.2}{unit}, \
                 {sigmas:.1} sigma"
            ),
        }
    }
}

/// Holds a revision against the present estimate; `None` while it holds, of values that nobody
/// estimated, and while nothing is known. What is from before a reassembly does not hold, wherever it came
/// from, until it is known what the robot is like now.
///
/// The present estimate `n` contains the data of the proposal `p`, so that the covariance of the
/// two is the variance of `n`, and the difference has the variance `sigma_p^2 - sigma_n^2`. That
/// goes to zero where both rest on nearly the same data, and what averaging cannot take away stands
/// in both; `sigma_p^2` bounds it. An estimator that has forgotten since (`sigma_n > sigma_p`) is
/// bounded by its own. The proposal is outdated when one of the four values has
/// `|n - p| > 3 max(sigma_p, sigma_n)`.
pub fn outdated(revision: &Revision, present: &Present) -> Option<Outdated> {
    const DEG: f64 = 180.0 / std::f64::consts::PI;
    const NAMED: [(&str, f64, &str); 4] = [
        ("steering offset", DEG, "°"),
        ("LiDAR x", 1e3, " mm"),
        ("LiDAR y", 1e3, " mm"),
        ("LiDAR yaw", DEG, "°"),
    ];
    let is_estimated = revision.origin == Origin::Estimator;
    let (values, sigmas) = match present {
        Present::Reassembled => return Some(Outdated::Reassembled),
        _ if !is_estimated => return None,
        Present::Unknown => return None,
        Present::VehicleChanged => return Some(Outdated::VehicleChanged),
        Present::Known { values, sigmas } => (values, sigmas),
    };
    let change = difference(&revision.values, values);
    let sigma = four(&revision.sigmas).into_iter().zip(four(sigmas));
    let parts = NAMED.into_iter().zip(change).zip(sigma);
    let moved = parts.filter_map(|((named, by), (proposed, now))| {
        let sigma = proposed.max(now);
        (by.abs() > OUTDATED_SIGMAS * sigma).then_some((named, by, by.abs() / sigma))
    });
    let most = moved.max_by(|a, b| a.2.total_cmp(&b.2));
    most.map(|((name, scale, unit), by, sigmas)| Outdated::Moved {
        name,
        by: by * scale,
        unit,
        sigmas,
    })
}
