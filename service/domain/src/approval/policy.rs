//! Policy of proposals, approvals and verification.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// How much of something is accepted, for each kind of value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Tolerance {
    /// Of the steering offset, degrees.
    pub steering_offset_deg: f64,
    /// Of the LiDAR's heading, degrees.
    pub lidar_yaw_deg: f64,
    /// Of the LiDAR's position along x and along y, mm.
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

    /// In the order and the units of [`super::Change`]: rad, m, m, rad.
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

/// Why a policy was refused: a key of it, its value and what is expected.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("approval.{key}: got {got}, expected {expected}")]
pub struct PolicyRefused {
    /// The key in `[approval]`, `verify_within.lidar_yaw_deg`.
    pub key: String,
    /// Its value.
    pub got: String,
    /// What is accepted, in words.
    pub expected: String,
}

/// `[approval]` of `fleetcal.toml`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(default, deny_unknown_fields)]
pub struct Policy {
    /// Whether the service proposes by itself what it has found.
    pub propose: bool,
    /// Proposed when it differs from what the robot uses by more than this.
    pub propose_beyond: Tolerance,
    /// And by more than so many sigmas.
    pub propose_sigmas: f64,
    /// And when it stood still within half of that for so long, s of message time.
    pub stable_for_s: f64,
    /// Approved without a person when the change is within this; never unless given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub approve_within: Option<Tolerance>,
    /// A change beyond this needs two approvers.
    pub two_approvers_beyond: Tolerance,
    /// Steering offsets beyond this are refused, degrees to either side.
    pub steering_offset_max_deg: f64,
    /// A LiDAR farther than this from the rear axle is refused, m along x and along y.
    pub lidar_distance_max_m: f64,
    /// A proposal expires after so long, and a deployment that no robot has taken, s.
    pub expires_after_s: u32,
    /// A robot that hears no confirmation for so long after applying goes back by itself, s.
    pub confirm_within_s: u32,
    /// The service's word that a document is wanted ends after so long, s; each answer to a robot has a
    /// new one.
    pub offer_valid_s: u32,
    /// Verified when what the robot now drives with differs from a verification estimate by less than
    /// this, twice the estimate's sigma included.
    pub verify_within: Tolerance,
    /// Which is judged after so much driving, m.
    pub verify_after_m: f64,
    /// Inconclusive when that was not possible for so long, s.
    pub verify_within_s: u32,
    /// Whether a calibration that fails its verification is rolled back without a person.
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
    /// Whether its numbers can be worked with.
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
