//! Documents of the life cycle.

use fleetcal_domain::approval::{
    Approval, Closing, Deployment, DeploymentState, Evidence, ExpectedGain, GenerationRef, InUse,
    Origin, Outdated, Proposal, ProposalState, Reported, Revision, RobotLedger, RollBack,
    SecondApprover, SyncState, Verification,
};
use fleetcal_model::{DeploymentId, Generation, Pose2, ProposalId, RevisionId, Version};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{AppliedStatus, CalibrationValues};
use jiff::Timestamp;
use serde::Serialize;

use crate::time;

/// A revision: what was found, for ever.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Revision)]
pub(super) struct RevisionDocument {
    /// Its number.
    id: RevisionId,
    /// Where it comes from.
    origin: Origin,
    /// The values, absolute.
    values: CalibrationValues,
    /// Their standard deviations; 0 where nobody measured.
    sigmas: CalibrationValues,
    /// Where the rear axle was in the robot's `base_link` when this was made; absent where that was
    /// not configured. The approved calibration is signed with this one.
    #[serde(skip_serializing_if = "Option::is_none")]
    rear_axle_in_base_link: Option<Pose2>,
    /// Version of the program that made it.
    estimator: String,
    /// SHA-256 of its content; approvals bind to it.
    sha256: String,
    #[schema(value_type = String, format = DateTime)]
    created: Timestamp,
    /// The data it rests on; absent for values that nobody measured here.
    evidence: Option<EvidenceDocument>,
}

/// What a revision rests on.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Evidence)]
struct EvidenceDocument {
    /// When its first datum was measured, by the robot's clock.
    #[schema(value_type = String, format = DateTime)]
    from: Timestamp,
    /// When its last datum was measured, by the robot's clock.
    #[schema(value_type = String, format = DateTime)]
    to: Timestamp,
    /// Distance driven, m.
    distance_m: f64,
    drive_samples: u64,
    scans: u64,
    /// Mean normalised innovation squared of the latest updates.
    nis_mean: f64,
    /// Its expectation.
    nis_dof: f64,
}

impl RevisionDocument {
    pub(super) fn of(revision: Revision) -> Self {
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
            }),
        }
    }
}

/// Somebody's decision.
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

/// A proposal with what it proposes. Its `ETag` is `version`.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Proposal)]
pub(super) struct ProposalDocument {
    /// Its number.
    id: ProposalId,
    robot: RobotId,
    /// Goes up with every change of it.
    version: Version,
    state: ProposalState,
    proposed_by: String,
    /// Why it was proposed.
    reason: Option<String>,
    #[schema(value_type = String, format = DateTime)]
    created: Timestamp,
    /// When it ends by itself.
    #[schema(value_type = String, format = DateTime)]
    expires: Timestamp,
    /// What is proposed.
    revision: RevisionDocument,
    /// What the robot used when this was proposed; absent when nobody knew.
    base: Option<CalibrationValues>,
    /// The generation of that.
    base_generation: Option<Generation>,
    /// Author of the drawing that its size is measured from; absent when it is measured from what was
    /// approved before, or the drawing is the configuration file's.
    #[serde(skip_serializing_if = "Option::is_none")]
    drawn_by: Option<String>,
    /// How many people have to agree.
    approvals_needed: u32,
    /// Reason for which more than one has to; absent when one is enough.
    #[serde(skip_serializing_if = "Option::is_none")]
    second_approver: Option<SecondApprover>,
    /// Who has agreed.
    approvals: Vec<DecisionDocument>,
    /// How it ended otherwise.
    closing: Option<DecisionDocument>,
    /// State of the deployment that followed from its approval, and `rolled_back` once a person has
    /// returned the robot to earlier values since; absent without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    deployment: Option<DeploymentState>,
    /// That the present estimate took the place of what was proposed; absent unless it did.
    #[serde(skip_serializing_if = "Option::is_none")]
    refreshed: Option<RefreshedDocument>,
    /// Why nobody can approve it at this moment: the present estimate speaks against it. It is
    /// refreshed or closed; absent while it holds, and once it is decided.
    #[serde(skip_serializing_if = "Option::is_none")]
    outdated: Option<String>,
    /// What it is expected to do for the robot's path following; absent while the robot has
    /// reported too few cross-track errors with the values in use.
    #[serde(skip_serializing_if = "Option::is_none")]
    expected_gain: Option<GainDocument>,
}

/// That the present estimate took the place of what was proposed.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Refreshed)]
struct RefreshedDocument {
    /// When it last was.
    #[schema(value_type = String, format = DateTime)]
    at: Timestamp,
    /// How often it was.
    times: u32,
    /// Why it last was.
    reason: String,
    /// Whose approvals that has voided.
    voided: Vec<String>,
}

/// Cross-track error with the values in use, and what is expected of it with the proposed ones.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = ExpectedGain)]
#[expect(clippy::struct_field_names, reason = "units stand last in names")]
struct GainDocument {
    /// Root mean square as the robot reported it with the values in use, m.
    measured_rms_m: f64,
    /// Root mean square that is expected with the proposed values when all that lasts comes from the
    /// calibration, m.
    expected_rms_m: f64,
    /// The same when nothing comes from it but the mean, m.
    expected_rms_max_m: f64,
}

/// What is known of a proposal beside its record.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Beside {
    /// Why it cannot be approved at this moment.
    pub(super) outdated: Option<Outdated>,
    /// What it is expected to do for the robot's path following.
    pub(super) gain: Option<ExpectedGain>,
    /// Where its deployment stands.
    pub(super) deployment: Option<DeploymentState>,
}

impl ProposalDocument {
    pub(super) fn of(proposal: Proposal, revision: Revision, beside: Beside) -> Self {
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

/// Values that a robot compensates with.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = InUse)]
pub(super) struct InUseDocument {
    /// Generation of the document; 0 for its factory calibration.
    generation: Generation,
    /// The revision; absent for its factory calibration.
    revision: Option<RevisionId>,
    values: CalibrationValues,
    /// Since when, by the robot's clock.
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

/// What a verification estimate said of the values in use.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Verification)]
struct VerificationDocument {
    #[schema(value_type = String, format = DateTime)]
    at: Timestamp,
    /// Distance driven since the values are in use, m.
    distance_m: f64,
    /// Verification estimate less values in use: steering offset (rad), LiDAR x (m), y (m), yaw (rad).
    residual: [f64; 4],
    /// Sigmas of the verification estimate, in the same order.
    sigma: [f64; 4],
    /// Whether the residual with twice its sigma is inside the tolerance.
    within: bool,
}

impl VerificationDocument {
    fn of(verification: Verification) -> Self {
        Self {
            at: time::of(verification.at_ns),
            distance_m: verification.distance_m,
            residual: verification.residual,
            sigma: verification.sigma,
            within: verification.within,
        }
    }
}

/// A revision on its way to one robot.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Deployment)]
pub(super) struct DeploymentDocument {
    /// Its number.
    id: DeploymentId,
    robot: RobotId,
    /// Goes up with every change of it.
    version: Version,
    state: DeploymentState,
    /// The proposal that was approved; absent for a return to an earlier calibration.
    proposal: Option<ProposalId>,
    /// Who approved it, or asked for the return.
    approved_by: String,
    /// What the robot is to hold now.
    offer: GenerationRef,
    /// What was offered before it was rolled back.
    earlier: Vec<GenerationRef>,
    /// What the robot used before; absent when nobody knew.
    base: Option<InUseDocument>,
    #[schema(value_type = String, format = DateTime)]
    created: Timestamp,
    /// When it ends by itself if the robot does not take it.
    #[schema(value_type = String, format = DateTime)]
    expires: Timestamp,
    /// When it was first shown to the robot.
    #[schema(value_type = Option<String>, format = DateTime)]
    offered: Option<Timestamp>,
    /// When the robot's answer was stored.
    #[schema(value_type = Option<String>, format = DateTime)]
    applied: Option<Timestamp>,
    /// When it ended.
    #[schema(value_type = Option<String>, format = DateTime)]
    closed: Option<Timestamp>,
    /// The latest verdict on it.
    verification: Option<VerificationDocument>,
    /// Why it stands where it stands.
    reason: Option<String>,
    /// Who rolled the robot back, why, and to which values; absent unless somebody did.
    roll_back: Option<RollBackDocument>,
}

/// Why former values came back to a robot.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = RollBack)]
struct RollBackDocument {
    /// Who asked for it: a person, or the service.
    by: String,
    /// Whether the service did it by itself.
    automatic: bool,
    #[schema(value_type = String, format = DateTime)]
    at: Timestamp,
    /// Why.
    reason: String,
    /// The values that come back.
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
    pub(super) fn of(deployment: Deployment) -> Self {
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
            verification: deployment.verification.map(VerificationDocument::of),
            reason: deployment.reason,
            roll_back: deployment.roll_back.map(RollBackDocument::of),
        }
    }
}

/// The latest answer of a robot.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Reported)]
struct ReportedDocument {
    generation: Generation,
    sha256: String,
    status: AppliedStatus,
    /// In the robot's words.
    reason: Option<String>,
    /// When, by the robot's clock.
    #[schema(value_type = String, format = DateTime)]
    at: Timestamp,
    /// When the service learnt of it.
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

/// Desired and reported state of one robot. Its `ETag` is `version`.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Shadow)]
pub(super) struct ShadowDocument {
    robot: RobotId,
    /// Goes up with every change of it.
    version: Version,
    /// What the robot should hold; absent before the first approval.
    desired: Option<GenerationRef>,
    /// What the robot last answered.
    reported: Option<ReportedDocument>,
    /// Whether the robot holds what it should.
    in_sync: bool,
    /// The same, and in which way it does not.
    sync: SyncState,
    /// What the robot uses, as far as it has said.
    in_use: Option<InUseDocument>,
    /// What it used before.
    before: Option<InUseDocument>,
    /// Generations that were verified, oldest first.
    verified: Vec<GenerationRef>,
    /// The proposal that waits.
    proposal: Option<ProposalId>,
    /// The deployment under way.
    deployment: Option<DeploymentDocument>,
}

impl ShadowDocument {
    pub(super) fn of(ledger: &RobotLedger) -> Self {
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

/// Where a robot's calibration stands, in the list of robots.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(crate) struct CalibrationSummary {
    /// The generation that the robot should hold; absent before the first approval.
    desired_generation: Option<Generation>,
    /// The generation that it uses; 0 for its factory calibration, absent when it never said.
    reported_generation: Option<Generation>,
    /// Whether the robot holds what it should.
    in_sync: bool,
    /// The same, and in which way it does not.
    sync: SyncState,
    /// What the robot compensates with, as far as it has said.
    in_use: Option<CalibrationValues>,
    /// The proposal that waits.
    proposal: Option<ProposalId>,
    /// Where the deployment under way stands.
    deployment: Option<DeploymentState>,
    /// Whether a verification estimate disagrees with what the robot uses.
    verification_failed: bool,
}

impl CalibrationSummary {
    /// The summary of a robot's records.
    pub(crate) fn of(ledger: &RobotLedger) -> Self {
        let shadow = &ledger.shadow;
        let live = ledger.live.as_ref();
        let verdict = live.and_then(|live| live.verification);
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
