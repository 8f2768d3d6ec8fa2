//! Certificate of a verified calibration, for an inspector who checks it without the service.
//!
//! It travels as an [`Envelope`](crate::calibration::Envelope): hash and Ed25519 signature are over
//! the exact bytes of its `document` string, which is a [`CertificateDocument`] in JSON. Angles are
//! in radians, lengths in metres, times RFC 3339 in UTC.

use serde::{Deserialize, Serialize};

use fleetcal_model::{
    CalibrationCovariance, DeploymentId, Generation, Motions, NisNoise, Pose2, RevisionId, RobotId,
    SpeedMeasuredAt, VehicleModel,
};

use crate::calibration::{CalibrationFrame, CalibrationValues};

/// Schema of a certificate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum CertificateSchema {
    /// The first version.
    #[default]
    #[serde(rename = "fleetcal.certificate/1")]
    V1,
}

/// Vehicle as configured at the time of the certificate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CertifiedVehicle {
    /// Steering geometry.
    pub model: VehicleModel,
    /// Distance from the rear axle to the steered axle, m.
    pub wheelbase_m: f64,
    /// Place of the speed measurement; absent for the model's own place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Object>))]
    pub speed_measured_at: Option<SpeedMeasuredAt>,
    /// The LiDAR's pose in `base` by the drawing, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nominal_lidar_in_base: Option<Pose2>,
}

/// Calibration that was verified, as the robot holds it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CertifiedCalibration {
    /// Generation of the document on the robot.
    pub generation: Generation,
    /// SHA-256 of that document, lower-case hexadecimal.
    pub document_sha256: String,
    /// The revision of the calibration.
    pub revision: RevisionId,
    /// The values, absolute.
    pub values: CalibrationValues,
    /// Their standard deviations, under the same names and units; 0 if they were not measured.
    pub sigmas: CalibrationValues,
    /// Covariance of the errors of the four values that every calibration has, if it was estimated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance: Option<CalibrationCovariance>,
    /// The frame of the LiDAR's pose.
    pub frame: CalibrationFrame,
    /// Pose of the rear axle's centre in the vehicle's `base_link`, if it was configured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rear_axle_in_base_link: Option<Pose2>,
}

/// Data that an estimate rests on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CertifiedEvidence {
    /// Time of the first datum, by the robot's clock.
    pub from: String,
    /// Time of the last one.
    pub to: String,
    /// Distance driven, m.
    pub distance_m: f64,
    /// Distance in each kind of motion, if it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motions: Option<Motions>,
    /// Drive samples used.
    pub drive_samples: u64,
    /// Scans or LiDAR poses used.
    pub scans: u64,
    /// Mean normalised innovation squared of the latest updates.
    pub nis_mean: f64,
    /// Expectation of `nis_mean`.
    pub nis_dof: f64,
    /// Noise that `nis_mean` is by; absent in certificates of older versions, which had the learnt noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nis_noise: Option<NisNoise>,
    /// Covariance of the errors of the four values, if it was estimated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance: Option<CalibrationCovariance>,
}

/// Verdict of an estimator that began from nothing with the values in use.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CertifiedVerification {
    /// Time of the verdict, by the service's clock.
    pub at: String,
    /// Distance driven with the values in use, m.
    pub distance_m: f64,
    /// Residual: its estimate minus the values in use.
    pub residual: CalibrationValues,
    /// Standard deviations of its estimate.
    pub sigmas: CalibrationValues,
    /// Limits: `|residual| + 2 sigma` is inside them for each value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<CalibrationValues>,
    /// Data that its estimate rests on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evidence: Option<CertifiedEvidence>,
}

/// Cross-track errors that the robot reported with one calibration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CertifiedCrossTrack {
    /// Generation of the calibration; 0 for the factory calibration.
    pub generation: Generation,
    /// Number of errors.
    pub count: u64,
    /// Root mean square of the errors, m.
    pub rms_m: f64,
    /// Mean of the errors, m; positive is left of the path.
    pub mean_m: f64,
}

/// Act of a person, the service, or a robot.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CertifiedAct {
    /// Name of the actor; `fleetcal` is the service itself.
    pub by: String,
    /// Time of the act, by the service's clock.
    pub at: String,
    /// Reason that was given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

/// Versions of the programs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CertifiedVersions {
    /// Version of the service that verified the calibration.
    pub service: String,
    /// Version of the program that found the values.
    pub estimator: String,
}

/// Certificate of a verified calibration: the content of its envelope.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CertificateDocument {
    /// Schema of the document.
    pub schema: CertificateSchema,
    /// Number of the certificate: that of the deployment which was verified.
    pub number: DeploymentId,
    /// Id of the robot.
    pub robot: RobotId,
    /// The vehicle, if it was configured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vehicle: Option<CertifiedVehicle>,
    /// The verified calibration.
    pub calibration: CertifiedCalibration,
    /// Data that the values rest on; absent for values that were not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evidence: Option<CertifiedEvidence>,
    /// SHA-256 of the revision: robot, origin, values, sigmas, evidence, estimator and time. People
    /// approve it by this hash.
    pub evidence_sha256: String,
    /// The verdict.
    pub verification: CertifiedVerification,
    /// Cross-track errors with the calibration in use before, if the robot reported any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cross_track_before: Option<CertifiedCrossTrack>,
    /// Cross-track errors with this calibration until the verdict, if the robot reported any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cross_track_after: Option<CertifiedCrossTrack>,
    /// Proposal of the values; absent for a return to an earlier calibration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub requested: Option<CertifiedAct>,
    /// Approvals, in their order; for a return to an earlier calibration its order.
    pub approved: Vec<CertifiedAct>,
    /// Application by the robot, when the service had stored its answer.
    pub applied: CertifiedAct,
    /// Versions of the programs.
    pub versions: CertifiedVersions,
}
