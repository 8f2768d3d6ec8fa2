//! Certificates in the store.

use fleetcal_model::{DeploymentId, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Envelope;

/// Certificate of a verified calibration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CertificateRecord {
    /// Number of the certificate: that of the deployment which was verified.
    pub number: DeploymentId,
    /// Robot of the calibration.
    pub robot: RobotId,
    /// Time of the verification, ns since 1970, wall time.
    pub verified_ns: WallTime,
    /// Approvers, as the deployment names them.
    pub approved_by: String,
    /// The signed document.
    pub envelope: Envelope,
}

/// Filter of certificates.
#[derive(Debug, Clone, Default)]
pub struct CertificateFilter {
    /// Robot of the certificates.
    pub robot: Option<RobotId>,
    /// Approvers of the certificates, as they are named.
    pub approved_by: Option<String>,
    /// Earliest wall time of a verification, ns.
    pub from_ns: Option<WallTime>,
    /// Wall time that the verifications come before, ns.
    pub to_ns: Option<WallTime>,
    /// Number that the certificates come before.
    pub before: Option<i64>,
    /// Largest number of certificates.
    pub limit: u32,
}
