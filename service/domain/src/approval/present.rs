//! Present estimate beside a proposal, which may be outdated by it.

use std::fmt;

use fleetcal_proto::calibration::CalibrationValues;

use super::revision::{Origin, Revision};
use super::values::{difference, four};

/// Distance from the present estimate beyond which a proposal is outdated, in sigmas.
const OUTDATED_SIGMAS: f64 = 3.0;
/// Shortest time between two refreshes of a proposal, ns, so that a reader can finish.
pub(super) const REFRESH_EVERY_NS: i64 = 60 * 1_000_000_000;

/// Present estimate of a robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Present {
    /// Estimate unavailable.
    Unknown,
    /// Reassembly reported, and the calibration not known again since.
    Reassembled,
    /// Two senders under the robot's id: what was learnt of them is discarded.
    TwoSenders,
    /// Vehicle changed since it was calibrated, and its new values not known yet.
    VehicleChanged,
    /// Known values.
    Known {
        /// Estimated values.
        values: CalibrationValues,
        /// Standard deviations of the values.
        sigmas: CalibrationValues,
    },
}

/// Reason for which a proposal is outdated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outdated {
    /// Robot reassembled, and its calibration not known again yet.
    Reassembled,
    /// Two senders under the robot's id: the values may be of both.
    TwoSenders,
    /// Vehicle changed since it was calibrated.
    VehicleChanged,
    /// Present estimate too far from the proposal.
    Moved {
        /// Value that is farthest from the proposal, in sigmas.
        name: &'static str,
        /// Difference: present estimate minus proposal, in `unit`.
        by: f64,
        /// Unit: degrees or millimetres.
        unit: &'static str,
        /// Difference in sigmas.
        sigmas: f64,
    },
}

impl fmt::Display for Outdated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Reassembled => f.write_str(
                "the robot was reassembled since, and its calibration is not known again yet",
            ),
            Self::TwoSenders => f.write_str(
                "two senders use the robot's id, and the values may be of the data of both",
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

/// Compares a revision with the present estimate; `None` if it agrees, if its values were not
/// estimated, and if the estimate is unknown. After a reassembly, earlier values of any origin are
/// outdated until the calibration is known again; estimated ones are while two senders use the
/// robot's id.
///
/// The present estimate `n` contains the data of the proposal `p`, so that the covariance of the
/// two is the variance of `n`, and the difference has the variance `sigma_p^2 - sigma_n^2`. That
/// goes to zero where both rest on nearly the same data, and errors that averaging cannot remove
/// are in both; `sigma_p^2` bounds it. An estimator that was reset since (`sigma_n > sigma_p`) is
/// bounded by its own sigma. The proposal is outdated when one of the four values has `|n - p| > 3
/// max(sigma_p, sigma_n)`.
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
        Present::TwoSenders => return Some(Outdated::TwoSenders),
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
