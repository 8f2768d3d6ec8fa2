//! Policy of proposals, approvals and verification.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Tolerance for each kind of value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Tolerance {
    /// Tolerance of the steering offset, degrees.
    pub steering_offset_deg: f64,
    /// Tolerance of the LiDAR's heading, degrees.
    pub lidar_yaw_deg: f64,
    /// Tolerance of the LiDAR's position along x and along y, mm.
    pub lidar_position_mm: f64,
}

impl Tolerance {
    const fn of(steering_offset_deg: f64, lidar_yaw_deg: f64, lidar_position_mm: f64) -> Self {
        Self {
            steering_offset_deg,
            lidar_yaw_deg,
            lidar_position_mm,
        }
    }

    /// Limits in the order and the units of [`super::Change`]: rad, m, m, rad.
    pub fn limits(&self) -> [f64; 4] {
        let position_m = self.lidar_position_mm / 1e3;
        [
            self.steering_offset_deg.to_radians(),
            position_m,
            position_m,
            self.lidar_yaw_deg.to_radians(),
        ]
    }

    fn check(&self, key: &str) -> Result<(), PolicyRefused> {
        let named = [
            ("steering_offset_deg", self.steering_offset_deg, 45.0),
            ("lidar_yaw_deg", self.lidar_yaw_deg, 180.0),
            ("lidar_position_mm", self.lidar_position_mm, 30_000.0),
        ];
        for (name, value, most) in named {
            if !(value > 0.0 && value <= most) {
                return Err(PolicyRefused {
                    key: format!("{key}.{name}"),
                    got: value.to_string(),
                    expected: format!("more than 0 and at most {most}"),
                });
            }
        }
        Ok(())
    }
}

/// Reason for which a policy was refused: a key, its value and the accepted values.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("approval.{key}: got {got}, expected {expected}")]
pub struct PolicyRefused {
    /// Key in `[approval]`, such as `verify_within.lidar_yaw_deg`.
    pub key: String,
    /// Value of the key.
    pub got: String,
    /// Accepted values, in words.
    pub expected: String,
}

/// `[approval]` of `fleetcal.toml`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(default, deny_unknown_fields)]
pub struct Policy {
    /// True if the service proposes estimates by itself.
    pub propose: bool,
    /// Smallest difference from the values in use that is proposed.
    pub propose_beyond: Tolerance,
    /// Smallest difference that is proposed, in sigmas.
    pub propose_sigmas: f64,
    /// Time for which an estimate must be stable within half of `propose_beyond` before it is
    /// proposed, s of message time.
    pub stable_for_s: f64,
    /// Largest change that is approved without a person; none is unless given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub approve_within: Option<Tolerance>,
    /// Largest change that one person may approve; beyond it, two must.
    pub two_approvers_beyond: Tolerance,
    /// Largest accepted steering offset, degrees to either side.
    pub steering_offset_max_deg: f64,
    /// Largest accepted distance of a LiDAR from the rear axle, m along x and along y.
    pub lidar_distance_max_m: f64,
    /// Time after which an undecided proposal expires, or a deployment that no robot has applied,
    /// s.
    pub expires_after_s: u32,
    /// Time after applying within which a robot must receive the confirmation, or it reverts by
    /// itself, s.
    pub confirm_within_s: u32,
    /// Duration for which an offer is valid, s; each answer to a robot has a new one.
    pub offer_valid_s: u32,
    /// Largest difference between the values in use and a verification estimate that passes
    /// verification, twice the estimate's sigma included.
    pub verify_within: Tolerance,
    /// Driven distance after which values in use are verified, m.
    pub verify_after_m: f64,
    /// Time after which an undecided verification is inconclusive, s.
    pub verify_within_s: u32,
    /// True if a calibration that fails its verification is rolled back automatically.
    pub roll_back: bool,
}

impl Default for Policy {
    fn default() -> Self {
        Self {
            propose: true,
            propose_beyond: Tolerance::of(0.15, 0.2, 10.0),
            propose_sigmas: 3.0,
            stable_for_s: 10.0,
            approve_within: None,
            two_approvers_beyond: Tolerance::of(5.0, 5.0, 50.0),
            steering_offset_max_deg: 15.0,
            lidar_distance_max_m: 30.0,
            expires_after_s: 24 * 3_600,
            confirm_within_s: 600,
            offer_valid_s: 24 * 3_600,
            verify_within: Tolerance::of(0.15, 0.2, 10.0),
            verify_after_m: 60.0,
            verify_within_s: 24 * 3_600,
            roll_back: true,
        }
    }
}

impl Policy {
    /// Checks its numbers.
    ///
    /// # Errors
    /// One sentence that names the key, the value and what is accepted.
    pub fn check(&self) -> Result<(), PolicyRefused> {
        self.propose_beyond.check("propose_beyond")?;
        self.two_approvers_beyond.check("two_approvers_beyond")?;
        self.verify_within.check("verify_within")?;
        if let Some(within) = &self.approve_within {
            within.check("approve_within")?;
            let fits = |(small, large): (f64, f64)| small <= large;
            let pairs = within.limits().into_iter();
            if !pairs.zip(self.two_approvers_beyond.limits()).all(fits) {
                return Err(PolicyRefused {
                    key: "approve_within".to_owned(),
                    got: "more than two_approvers_beyond".to_owned(),
                    expected: "changes that one person could approve".to_owned(),
                });
            }
        }
        let numbers = [
            ("propose_sigmas", self.propose_sigmas, 0.0, 100.0),
            ("stable_for_s", self.stable_for_s, 0.0, 86_400.0),
            (
                "steering_offset_max_deg",
                self.steering_offset_max_deg,
                0.1,
                90.0,
            ),
            (
                "lidar_distance_max_m",
                self.lidar_distance_max_m,
                0.01,
                30.0,
            ),
            (
                "expires_after_s",
                f64::from(self.expires_after_s),
                60.0,
                31_536_000.0,
            ),
            (
                "confirm_within_s",
                f64::from(self.confirm_within_s),
                1.0,
                86_400.0,
            ),
            (
                "offer_valid_s",
                f64::from(self.offer_valid_s),
                60.0,
                31_536_000.0,
            ),
            ("verify_after_m", self.verify_after_m, 1.0, 100_000.0),
            (
                "verify_within_s",
                f64::from(self.verify_within_s),
                60.0,
                31_536_000.0,
            ),
        ];
        for (key, value, least, most) in numbers {
            if !(least..=most).contains(&value) {
                return Err(PolicyRefused {
                    key: key.to_owned(),
                    got: value.to_string(),
                    expected: format!("{least} to {most}"),
                });
            }
        }
        Ok(())
    }
}
