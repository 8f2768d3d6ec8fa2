//! Documents of the life cycle.

use fleetcal_domain::approval::{
    Approval, Closing, Deployment, DeploymentState, Evidence, ExpectedGain, GenerationRef, InUse,
    Origin, Outdated, Proposal, ProposalState, Reported, Revision, RobotLedger, RollBack,
    SecondApprover, SyncState, Verification,
};
use fleetcal_domain::timestamp as time;
use fleetcal_model::{DeploymentId, Generation, NisNoise, Pose2, ProposalId, RevisionId, Version};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{AppliedStatus, CalibrationValues};
use jiff::Timestamp;
use serde::Serialize;

/// Revision: values with their evidence, kept for ever.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Revision)]
pub struct RevisionDocument {
    /// Number of the revision.
    id: RevisionId,
    /// Origin of the values.
    origin: Origin,
    /// Values, absolute.
    values: CalibrationValues,
    /// Standard deviations of the values; 0 if they were not measured.
    sigmas: CalibrationValues,
    /// Pose of the rear axle in the robot's `base_link` at the time of the revision; absent if it
    /// was not configured. The approved calibration is signed with it.
    #[serde(skip_serializing_if = "Option::is_none")]
    rear_axle_in_base_link: Option<Pose2>,
    /// Version of the program that made it.
    estimator: String,
    /// Hash (SHA-256) of its content; approvals bind to it.
    sha256: String,
    #[schema(value_type = String, format = DateTime)]
    created: Timestamp,
    /// Evidence for the values; absent for values that were not measured here.
    evidence: Option<EvidenceDocument>,
}

/// Evidence for a revision.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Evidence)]
struct EvidenceDocument {
    /// Time of its first datum, by the robot's clock.
    #[schema(value_type = String, format = DateTime)]
    from: Timestamp,
    /// Time of its last datum, by the robot's clock.
    #[schema(value_type = String, format = DateTime)]
    to: Timestamp,
    /// Distance driven, m.
    distance_m: f64,
    drive_samples: u64,
    scans: u64,
    /// Mean normalised innovation squared of the latest updates.
    nis_mean: f64,
    /// Expectation of `nis_mean`.
    nis_dof: f64,
    /// Noise that `nis_mean` is by; absent in evidence of older versions, which had the learnt noise.
    #[serde(skip_serializing_if = "Option::is_none")]
    nis_noise: Option<NisNoise>,
}

impl RevisionDocument {
    /// Makes the document of a record.
    pub fn of(revision: Revision) -> Self {
        let evidence = (revision.evidence != Evidence::default()).then_some(revision.evidence);
        Self {
            id: revision.id,
            origin: revision.origin,
            values: revision.values,
            sigmas: revision.sigmas,
            rear_axle_in_base_link: revision.rear_axle_in_base_link,
            estimator: revision.estimator,
            sha256: revision.sha256,
            created: time::of(revision.created_ns),
            evidence: evidence.map(|evidence| EvidenceDocument {
                from: time::of_robot(evidence.from_ns),
                to: time::of_robot(evidence.to_ns),
                distance_m: evidence.distance_m,
                drive_samples: evidence.drive_samples,
                scans: evidence.scans,
                nis_mean: evidence.nis_mean,
                nis_dof: evidence.nis_dof,
                nis_noise: evidence.nis_noise,
            }),
        }
    }
}

/// Decision of a person, or of the service.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = DecisionMade)]
struct DecisionDocument {
    by: String,
    #[schema(value_type = String, format = DateTime)]
    at: Timestamp,
    reason: Option<String>,
}

impl DecisionDocument {
    fn of_approval(approval: Approval) -> Self {
        Self {
            by: approval.by,
            at: time::of(approval.at_ns),
            reason: approval.reason,
        }
    }

    fn of_closing(closing: Closing) -> Self {
        Self {
            by: closing.by,
            at: time::of(closing.at_ns),
            reason: closing.reason,
        }
    }
}

/// Proposal with its revision. Its `ETag` is `version`.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Proposal)]
pub struct ProposalDocument {
    /// Number of the proposal.
    id: ProposalId,
    robot: RobotId,
    /// Version, incremented with every change.
    version: Version,
    state: ProposalState,
    proposed_by: String,
    /// Reason for the proposal.
    reason: Option<String>,
    #[schema(value_type = String, format = DateTime)]
    created: Timestamp,
    /// Time at which it expires.
    #[schema(value_type = String, format = DateTime)]
    expires: Timestamp,
    /// Proposed revision.
    revision: RevisionDocument,
    /// Values in use at the time of the proposal; absent if unknown.
    base: Option<CalibrationValues>,
    /// Generation of the values in use at that time.
    base_generation: Option<Generation>,
    /// Author of the drawing that the change is measured from; absent if it is measured from an
    /// approved calibration, or the drawing is the configuration file's.
    #[serde(skip_serializing_if = "Option::is_none")]
    drawn_by: Option<String>,
    /// Number of approvals needed.
    approvals_needed: u32,
    /// Reason for which more than one is needed; absent if one is enough.
    #[serde(skip_serializing_if = "Option::is_none")]
    second_approver: Option<SecondApprover>,
    /// Approvals given.
    approvals: Vec<DecisionDocument>,
    /// Closing without a deployment, if it was closed.
    closing: Option<DecisionDocument>,
    /// State of the deployment after its approval, and `rolled_back` once a person has returned the
    /// robot to earlier values; absent without a deployment.
    #[serde(skip_serializing_if = "Option::is_none")]
    deployment: Option<DeploymentState>,
    /// Replacements of the proposed values by the present estimate; absent before the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    refreshed: Option<RefreshedDocument>,
    /// Reason for which it cannot be approved now: the present estimate contradicts it, and it will
    /// be refreshed or closed. Absent while the estimate agrees, and after the decision.
    #[serde(skip_serializing_if = "Option::is_none")]
    outdated: Option<String>,
    /// Gain expected for the robot's path following; absent while the robot has reported too few
    /// cross-track errors with the values in use.
    #[serde(skip_serializing_if = "Option::is_none")]
    expected_gain: Option<GainDocument>,
}

/// Replacement of the proposed values by the present estimate.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Refreshed)]
struct RefreshedDocument {
    /// Time of the last replacement.
    #[schema(value_type = String, format = DateTime)]
    at: Timestamp,
    /// Number of replacements.
    times: u32,
    /// Reason for the last replacement.
    reason: String,
    /// People whose approvals became void.
    voided: Vec<String>,
}

/// Cross-track error with the values in use, and its expectation with the proposed ones.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = ExpectedGain)]
#[expect(clippy::struct_field_names, reason = "units stand last in names")]
struct GainDocument {
    /// Root mean square that the robot reported with the values in use, m.
    measured_rms_m: f64,
    /// Expected root mean square with the proposed values if all lasting errors come from the
    /// calibration, m.
    expected_rms_m: f64,
    /// Expected root mean square if of these only the mean comes from it and errors of other minutes
    /// are larger by chance, m.
    expected_rms_max_m: f64,
}

/// Facts about a proposal beside its record.
#[derive(Debug, Clone, Copy, Default)]
pub struct Beside {
    /// Reason for which it cannot be approved now.
    pub outdated: Option<Outdated>,
    /// Gain expected for the robot's path following.
    pub gain: Option<ExpectedGain>,
    /// State of its deployment.
    pub deployment: Option<DeploymentState>,
}

impl ProposalDocument {
    /// Makes the document of a record.
    pub fn of(proposal: Proposal, revision: Revision, beside: Beside) -> Self {
        let approvals = proposal.approvals.into_iter();
        Self {
            id: proposal.id,
            robot: proposal.robot,
            version: proposal.version,
            state: proposal.state,
            proposed_by: proposal.proposed_by,
            reason: proposal.reason,
            created: time::of(proposal.created_ns),
            expires: time::of(proposal.expires_ns),
            revision: RevisionDocument::of(revision),
            base: proposal.base,
            base_generation: proposal.base_generation,
            drawn_by: proposal.drawn_by,
            approvals_needed: proposal.approvals_needed,
            second_approver: proposal.second_approver,
            approvals: approvals.map(DecisionDocument::of_approval).collect(),
            closing: proposal.closing.map(DecisionDocument::of_closing),
            deployment: beside.deployment,
            refreshed: proposal.refreshed.map(|refreshed| RefreshedDocument {
                at: time::of(refreshed.at_ns),
                times: refreshed.times,
                reason: refreshed.reason,
                voided: refreshed.voided,
            }),
            outdated: beside.outdated.map(|outdated| outdated.to_string()),
            expected_gain: beside.gain.map(|gain| GainDocument {
                measured_rms_m: gain.measured_rms_m,
                expected_rms_m: gain.expected_rms_m,
                expected_rms_max_m: gain.expected_rms_max_m,
            }),
        }
    }
}

/// Values in use of a robot.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = InUse)]
struct InUseDocument {
    /// Generation of the document; 0 for its factory calibration.
    generation: Generation,
    /// Revision; absent for its factory calibration.
    revision: Option<RevisionId>,
    values: CalibrationValues,
    /// Begin of their use, by the robot's clock.
    #[schema(value_type = String, format = DateTime)]
    since: Timestamp,
}

impl InUseDocument {
    fn of(in_use: &InUse) -> Self {
        Self {
            generation: in_use.generation,
            revision: in_use.revision,
            values: in_use.values,
            since: time::of_robot(in_use.since_ns),
        }
    }
}

/// Verdict of a verification estimate on the values in use.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Verification)]
struct VerificationDocument {
    #[schema(value_type = String, format = DateTime)]
    at: Timestamp,
    /// Distance driven with the values in use, m.
    distance_m: f64,
    /// Residual: verification estimate minus values in use; steering offset (rad), LiDAR x (m), y
    /// (m), yaw (rad).
    residual: [f64; 4],
    /// Sigmas of the verification estimate, in the same order.
    sigma: [f64; 4],
    /// True if the residual with twice its sigma is inside the tolerance.
    within: bool,
}

impl VerificationDocument {
    fn of(verification: &Verification) -> Self {
        Self {
            at: time::of(verification.at_ns),
            distance_m: verification.distance_m,
            residual: verification.residual,
            sigma: verification.sigma,
            within: verification.within,
        }
    }
}

/// Deployment of a revision to one robot.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Deployment)]
pub struct DeploymentDocument {
    /// Number of the deployment.
    id: DeploymentId,
    robot: RobotId,
    /// Version, incremented with every change.
    version: Version,
    state: DeploymentState,
    /// Approved proposal; absent for a return to an earlier calibration.
    proposal: Option<ProposalId>,
    /// Person who approved it, or ordered the return.
    approved_by: String,
    /// Document that the robot should use now.
    offer: GenerationRef,
    /// Documents offered before the roll-back.
    earlier: Vec<GenerationRef>,
    /// Calibration in use before; absent if unknown.
    base: Option<InUseDocument>,
    #[schema(value_type = String, format = DateTime)]
    created: Timestamp,
    /// Time at which it ends unless the robot applies it.
    #[schema(value_type = String, format = DateTime)]
    expires: Timestamp,
    /// Time of the first offer to the robot.
    #[schema(value_type = Option<String>, format = DateTime)]
    offered: Option<Timestamp>,
    /// Time at which the robot's answer was stored.
    #[schema(value_type = Option<String>, format = DateTime)]
    applied: Option<Timestamp>,
    /// Time at which it ended.
    #[schema(value_type = Option<String>, format = DateTime)]
    closed: Option<Timestamp>,
    /// Latest verdict of a verification.
    verification: Option<VerificationDocument>,
    /// Reason for its state.
    reason: Option<String>,
    /// Roll-back of the robot: who ordered it, why, and the restored values; absent without one.
    roll_back: Option<RollBackDocument>,
}

/// Roll-back of a robot to former values.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = RollBack)]
struct RollBackDocument {
    /// Person who ordered it, or the service.
    by: String,
    /// True if the service ordered it.
    automatic: bool,
    #[schema(value_type = String, format = DateTime)]
    at: Timestamp,
    /// Reason for the roll-back.
    reason: String,
    /// Restored values.
    values: CalibrationValues,
}

impl RollBackDocument {
    fn of(roll_back: RollBack) -> Self {
        Self {
            by: roll_back.by,
            automatic: roll_back.automatic,
            at: time::of(roll_back.at_ns),
            reason: roll_back.reason,
            values: roll_back.values,
        }
    }
}

impl DeploymentDocument {
    /// Makes the document of a record.
    pub fn of(deployment: Deployment) -> Self {
        Self {
            id: deployment.id,
            robot: deployment.robot,
            version: deployment.version,
            state: deployment.state,
            proposal: deployment.proposal,
            approved_by: deployment.approved_by,
            offer: deployment.offer,
            earlier: deployment.earlier,
            base: deployment.base.as_ref().map(InUseDocument::of),
            created: time::of(deployment.created_ns),
            expires: time::of(deployment.expires_ns),
            offered: deployment.offered_ns.map(time::of),
            applied: deployment.applied_ns.map(time::of),
            closed: deployment.closed_ns.map(time::of),
            verification: deployment
                .verification
                .as_ref()
                .map(VerificationDocument::of),
            reason: deployment.reason,
            roll_back: deployment.roll_back.map(RollBackDocument::of),
        }
    }
}

/// Latest answer of a robot.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Reported)]
struct ReportedDocument {
    generation: Generation,
    sha256: String,
    status: AppliedStatus,
    /// Reason that the robot gave.
    reason: Option<String>,
    /// Time of the outcome, by the robot's clock.
    #[schema(value_type = String, format = DateTime)]
    at: Timestamp,
    /// Time at which the service received it.
    #[schema(value_type = String, format = DateTime)]
    received: Timestamp,
}

impl ReportedDocument {
    fn of(reported: Reported) -> Self {
        Self {
            generation: reported.generation,
            sha256: reported.sha256,
            status: reported.status,
            reason: reported.reason,
            at: time::of_robot(reported.at_ns),
            received: time::of(reported.received_ns),
        }
    }
}

/// Desired and reported calibration of one robot. Its `ETag` is `version`.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Shadow)]
pub struct ShadowDocument {
    robot: RobotId,
    /// Version, incremented with every change.
    version: Version,
    /// Desired calibration; absent before the first approval.
    desired: Option<GenerationRef>,
    /// Latest answer of the robot.
    reported: Option<ReportedDocument>,
    /// True if the robot uses the desired calibration.
    in_sync: bool,
    /// Agreement between the calibration in use and the desired one.
    sync: SyncState,
    /// Calibration in use, as the robot last reported it.
    in_use: Option<InUseDocument>,
    /// Calibration in use before that one.
    before: Option<InUseDocument>,
    /// Generations that were verified, oldest first.
    verified: Vec<GenerationRef>,
    /// Open proposal.
    proposal: Option<ProposalId>,
    /// Deployment under way.
    deployment: Option<DeploymentDocument>,
}

impl ShadowDocument {
    /// Makes the document of a record.
    pub fn of(ledger: &RobotLedger) -> Self {
        let shadow = ledger.shadow.clone();
        Self {
            in_sync: shadow.in_sync(),
            sync: shadow.sync(),
            robot: shadow.robot,
            version: shadow.version,
            desired: shadow.desired,
            reported: shadow.reported.map(ReportedDocument::of),
            in_use: shadow.in_use.as_ref().map(InUseDocument::of),
            before: shadow.before.as_ref().map(InUseDocument::of),
            verified: shadow.verified,
            proposal: ledger.open.as_ref().map(|open| open.id),
            deployment: ledger.live.clone().map(DeploymentDocument::of),
        }
    }
}

/// State of a robot's calibration, in the list of robots.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct CalibrationSummary {
    /// Desired generation; absent before the first approval.
    desired_generation: Option<Generation>,
    /// Generation in use; 0 for the factory calibration, absent if the robot never reported one.
    reported_generation: Option<Generation>,
    /// True if the robot uses the desired calibration.
    in_sync: bool,
    /// Agreement between the calibration in use and the desired one.
    sync: SyncState,
    /// Values in use, as the robot last reported them.
    in_use: Option<CalibrationValues>,
    /// Open proposal.
    proposal: Option<ProposalId>,
    /// State of the deployment under way.
    deployment: Option<DeploymentState>,
    /// True if a verification estimate disagrees with the values in use.
    verification_failed: bool,
}

impl CalibrationSummary {
    /// Summary of a robot's records.
    pub fn of(ledger: &RobotLedger) -> Self {
        let shadow = &ledger.shadow;
        let live = ledger.live.as_ref();
        let verdict = live.and_then(|live| live.verification.as_ref());
        Self {
            desired_generation: shadow.desired.as_ref().map(|desired| desired.generation),
            reported_generation: shadow.in_use.as_ref().map(|in_use| in_use.generation),
            in_sync: shadow.in_sync(),
            sync: shadow.sync(),
            in_use: shadow.in_use.as_ref().map(|in_use| in_use.values),
            proposal: ledger.open.as_ref().map(|open| open.id),
            deployment: live.map(|live| live.state),
            verification_failed: verdict.is_some_and(|verdict| !verdict.within),
        }
    }
}
