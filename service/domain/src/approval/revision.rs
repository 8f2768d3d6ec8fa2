//! Revision of a calibration, kept for ever.

use fleetcal_model::{
    CalibrationCovariance, Motions, NisNoise, Pose2, RevisionId, RobotTime, SteeringTable, WallTime,
};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationValues;
use fleetcal_proto::estimate::EstimateDocument;
use fleetcal_proto::signing::sha256_hex;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// Origin of a revision.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// Estimate of the service.
    Estimator,
    /// Values of a person.
    Person,
    /// Values that the robot reported.
    Robot,
}

/// Evidence for a revision. Empty for values that were not measured here.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
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
    /// Expectation of `nis_mean`.
    pub nis_dof: f64,
    /// Noise that `nis_mean` is by; absent in evidence of older versions, which had the learnt noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nis_noise: Option<NisNoise>,
    /// Covariance of the errors of the four values. Evidence of older versions without it keeps its
    /// hash.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance: Option<CalibrationCovariance>,
    /// Distance in each kind of motion; absent in evidence of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motions: Option<Motions>,
    /// Curve of the steering where it was known; absent in evidence of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steering_table: Option<SteeringTable>,
}

impl Evidence {
    /// Evidence of an estimate.
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
            nis_noise: estimate.consistency.nis_noise(),
            covariance: estimate.covariance,
            motions: estimate.motions,
            steering_table: estimate
                .steering_table
                .as_ref()
                .and_then(SteeringTable::known)
                .cloned(),
        }
    }
}

/// Calibration values with their evidence. Never changed once written.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Revision {
    /// Number of the revision.
    pub id: RevisionId,
    /// Robot of the values.
    pub robot: RobotId,
    /// Origin of the values.
    pub origin: Origin,
    /// Values, absolute.
    pub values: CalibrationValues,
    /// Standard deviations of the values; 0 if they were not measured.
    pub sigmas: CalibrationValues,
    /// Evidence for the values.
    pub evidence: Evidence,
    /// Pose of the rear axle in the robot's `base_link` at the time of the revision, if configured:
    /// an approved and signed calibration keeps it, whatever is configured later.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rear_axle_in_base_link: Option<Pose2>,
    /// Version of the program that made it.
    pub estimator: String,
    /// Time of the revision, ns since 1970, wall time.
    pub created_ns: WallTime,
    /// SHA-256 over all of the above but the number, lower-case hexadecimal.
    pub sha256: String,
}

impl Revision {
    /// Makes a revision.
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

    /// SHA-256 of its content.
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
