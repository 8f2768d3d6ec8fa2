//! From the records of a verification to the document.

use std::collections::BTreeMap;

use fleetcal_domain::approval::{Change, Deployment, Evidence, Proposal, Revision, Verification};
use fleetcal_domain::robot::{CrossTrack, RobotConfig};
use fleetcal_domain::timestamp;
use fleetcal_model::{Generation, WallTime};
use fleetcal_proto::calibration::{CalibrationFrame, CalibrationValues};
use fleetcal_proto::certificate::{
    CertificateDocument, CertificateSchema, CertifiedAct, CertifiedCalibration,
    CertifiedCrossTrack, CertifiedEvidence, CertifiedVehicle, CertifiedVerification,
    CertifiedVersions,
};

/// Records of a verification that agreed.
#[derive(Debug, Clone, Copy)]
pub struct Verified<'a> {
    /// Deployment that was verified.
    pub deployment: &'a Deployment,
    /// Verdict of the verification.
    pub verification: &'a Verification,
    /// Revision that the deployment brought.
    pub revision: &'a Revision,
    /// Approved proposal; `None` for a return to an earlier calibration.
    pub proposal: Option<&'a Proposal>,
    /// Configuration of the robot.
    pub vehicle: Option<&'a RobotConfig>,
    /// Cross-track errors of the robot, by generation.
    pub cross_tracks: &'a BTreeMap<Generation, CrossTrack>,
}

/// Makes the certificate of a verified calibration.
pub fn certificate(of: &Verified<'_>) -> CertificateDocument {
    let (deployment, revision) = (of.deployment, of.revision);
    let before = deployment.base.as_ref().map(|base| base.generation);
    let generation = deployment.offer.generation;
    CertificateDocument {
        schema: CertificateSchema::V1,
        number: deployment.id,
        robot: deployment.robot.clone(),
        vehicle: of.vehicle.map(vehicle),
        calibration: calibration(deployment, revision),
        evidence: evidence(&revision.evidence),
        evidence_sha256: revision.sha256.clone(),
        verification: verification(of.verification),
        cross_track_before: cross_track(of, before.unwrap_or(Generation::FACTORY)),
        cross_track_after: cross_track(of, generation),
        requested: of.proposal.map(requested),
        approved: approved(deployment, of.proposal),
        applied: CertifiedAct {
            by: deployment.robot.to_string(),
            at: time(deployment.applied_ns.unwrap_or(deployment.created_ns)),
            reason: None,
        },
        versions: CertifiedVersions {
            service: env!("CARGO_PKG_VERSION").to_owned(),
            estimator: revision.estimator.clone(),
        },
    }
}

fn vehicle(config: &RobotConfig) -> CertifiedVehicle {
    CertifiedVehicle {
        model: config.model,
        wheelbase_m: config.wheelbase_m.metres(),
        speed_measured_at: config.speed_measured_at,
        nominal_lidar_in_base: config.nominal_extrinsics.map(|mount| mount.pose()),
    }
}

fn calibration(deployment: &Deployment, revision: &Revision) -> CertifiedCalibration {
    CertifiedCalibration {
        generation: deployment.offer.generation,
        document_sha256: deployment.offer.sha256.clone(),
        revision: revision.id,
        values: revision.values,
        sigmas: revision.sigmas,
        covariance: revision.evidence.covariance,
        frame: CalibrationFrame::RearAxle,
        rear_axle_in_base_link: revision.rear_axle_in_base_link,
    }
}

/// Data of an estimate; `None` for values that were not measured here.
fn evidence(evidence: &Evidence) -> Option<CertifiedEvidence> {
    (evidence.drive_samples > 0).then(|| CertifiedEvidence {
        from: timestamp::of_robot(evidence.from_ns).to_string(),
        to: timestamp::of_robot(evidence.to_ns).to_string(),
        distance_m: evidence.distance_m,
        motions: evidence.motions,
        drive_samples: evidence.drive_samples,
        scans: evidence.scans,
        nis_mean: evidence.nis_mean,
        nis_dof: evidence.nis_dof,
        nis_noise: evidence.nis_noise,
        covariance: evidence.covariance,
    })
}

fn verification(verdict: &Verification) -> CertifiedVerification {
    CertifiedVerification {
        at: time(verdict.at_ns),
        distance_m: verdict.distance_m,
        residual: named(verdict.residual),
        sigmas: named(verdict.sigma),
        limits: verdict.limits.map(named),
        evidence: verdict.evidence.as_ref().and_then(evidence),
    }
}

/// Gives the parts of a change their names.
fn named([steering_offset_rad, lidar_x_m, lidar_y_m, lidar_yaw_rad]: Change) -> CalibrationValues {
    CalibrationValues {
        steering_offset_rad,
        lidar_x_m,
        lidar_y_m,
        lidar_yaw_rad,
        ..CalibrationValues::default()
    }
}

fn cross_track(of: &Verified<'_>, generation: Generation) -> Option<CertifiedCrossTrack> {
    let errors = of.cross_tracks.get(&generation)?;
    (errors.count > 0).then(|| CertifiedCrossTrack {
        generation,
        count: errors.count,
        rms_m: errors.rms_m(),
        mean_m: errors.mean_m(),
    })
}

fn requested(proposal: &Proposal) -> CertifiedAct {
    CertifiedAct {
        by: proposal.proposed_by.clone(),
        at: time(proposal.created_ns),
        reason: proposal.reason.clone(),
    }
}

fn approved(deployment: &Deployment, proposal: Option<&Proposal>) -> Vec<CertifiedAct> {
    let Some(proposal) = proposal else {
        return vec![CertifiedAct {
            by: deployment.approved_by.clone(),
            at: time(deployment.created_ns),
            reason: deployment.roll_back.as_ref().map(|one| one.reason.clone()),
        }];
    };
    let approvals = proposal.approvals.iter();
    let acts = approvals.map(|approval| CertifiedAct {
        by: approval.by.clone(),
        at: time(approval.at_ns),
        reason: approval.reason.clone(),
    });
    acts.collect()
}

fn time(wall: WallTime) -> String {
    timestamp::of(wall).to_string()
}
