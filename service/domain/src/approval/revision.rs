//! Revision of a calibration, kept for ever.

use fleetcal_model::{CalibrationCovariance, Pose2, RevisionId, RobotTime, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationValues;
use fleetcal_proto::estimate::EstimateDocument;
use fleetcal_proto::signing::sha256_hex;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// Where a revision comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// The estimator found it.
    Estimator,
    /// A person gave it.
    Person,
    /// The robot brought it along.
    Robot,
}

/// What a revision rests on. Empty for values that nobody measured here.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Evidence {
    /// Message time of the first datum, ns since 1970.
    pub from_ns: RobotTime,
    /// Message time of the last one.
    pub to_ns: RobotTime,
    /// Distance driven, m.
    pub distance_m: f64,
    /// Drive samples used.
    pub drive_samples: u64,
    /// Scans or LiDAR poses used.
    pub scans: u64,
    /// Mean normalised innovation squared of the latest updates.
    pub nis_mean: f64,
    /// Its expectation.
    pub nis_dof: f64,
    /// How the errors of the four values go together. It came later: evidence without it keeps its
    /// hash.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance: Option<CalibrationCovariance>,
}

impl Evidence {
    /// What an estimate rests on.
    pub fn of(estimate: &EstimateDocument) -> Self {
        let last = estimate.stamp_ns;
        Self {
            from_ns: last.plus_seconds(-estimate.time_s),
            to_ns: last,
            distance_m: estimate.distance_m,
            drive_samples: estimate.counts.drive_samples,
            scans: estimate.counts.scans,
            nis_mean: estimate.consistency.nis_mean,
            nis_dof: estimate.consistency.nis_dof,
            covariance: estimate.covariance,
        }
    }
}

/// Calibration values with what they rest on. Never changed once written.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Revision {
    /// Its number.
    pub id: RevisionId,
    /// Whose.
    pub robot: RobotId,
    /// Where it comes from.
    pub origin: Origin,
    /// The values, absolute.
    pub values: CalibrationValues,
    /// Their standard deviations; 0 where nobody measured.
    pub sigmas: CalibrationValues,
    /// What they rest on.
    pub evidence: Evidence,
    /// Where the rear axle was in the robot's `base_link` when this was made, where that was
    /// configured: a calibration that is approved and signed has this one, whatever is configured later.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rear_axle_in_base_link: Option<Pose2>,
    /// Version of the program that made it.
    pub estimator: String,
    /// When, ns since 1970, wall time.
    pub created_ns: WallTime,
    /// SHA-256 over all of the above but the number, lower-case hexadecimal.
    pub sha256: String,
}

impl Revision {
    /// A new revision.
    pub fn new(
        id: RevisionId,
        robot: RobotId,
        origin: Origin,
        (values, sigmas): (CalibrationValues, CalibrationValues),
        evidence: Evidence,
        rear_axle_in_base_link: Option<Pose2>,
        created_ns: WallTime,
    ) -> Self {
        let mut revision = Self {
            id,
            robot,
            origin,
            values,
            sigmas,
            evidence,
            rear_axle_in_base_link,
            estimator: env!("CARGO_PKG_VERSION").to_owned(),
            created_ns,
            sha256: String::new(),
        };
        revision.sha256 = revision.hash();
        revision
    }

    /// The hash of its content.
    pub fn hash(&self) -> String {
        let mut content = vec![
            json!(self.robot),
            json!(self.origin),
            json!(self.values),
            json!(self.sigmas),
            json!(self.evidence),
            json!(self.estimator),
            json!(self.created_ns),
        ];
        // It came later: what was hashed before has to keep its hash.
        content.extend(self.rear_axle_in_base_link.map(|axle| json!(axle)));
        let content = serde_json::Value::from(content);
        sha256_hex(content.to_string().as_bytes())
    }
}
