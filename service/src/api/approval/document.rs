//! What the API says about the life cycle.

use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{AppliedStatus, CalibrationValues};
use fleetcal_proto::estimate::PoseDocument;
use jiff::Timestamp;
use serde::Serialize;

use crate::api::time;
use crate::approval::{
    Approval, Closing, Deployment, DeploymentState, Evidence, GenerationRef, InUse, Origin,
    Proposal, ProposalState, Reported, Revision, RobotLedger, Verification,
};

/// A revision: what was found, for ever.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Revision)]
pub(super) struct RevisionDocument {
    /// Its number.
    id: u64,
    /// Where it comes from.
    origin: Origin,
    /// The values, absolute.
    values: CalibrationValues,
    /// Their standard deviations; 0 where nobody measured.
    sigmas: CalibrationValues,
    /// Where the rear axle was in the robot's `base_link` when this was made; absent where that was
    /// not configured. What is approved is signed with this one.
    #[serde(skip_serializing_if = "Option::is_none")]
    rear_axle_in_base_link: Option<PoseDocument>,
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
            created: time::of_ns(revision.created_ns),
            evidence: evidence.map(|evidence| EvidenceDocument {
                from: time::of_ns(evidence.from_ns),
                to: time::of_ns(evidence.to_ns),
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
            at: time::of_ns(approval.at_ns),
            reason: approval.reason,
        }
    }

    fn of_closing(closing: Closing) -> Self {
        Self {
            by: closing.by,
            at: time::of_ns(closing.at_ns),
            reason: closing.reason,
        }
    }
}

/// A proposal with what it proposes. Its `ETag` is `version`.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Proposal)]
pub(super) struct ProposalDocument {
    /// Its number.
    id: u64,
    robot: RobotId,
    /// Goes up with every change of it.
    version: u64,
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
    base_generation: Option<u64>,
    /// How many people have to agree.
    approvals_needed: u32,
    /// Who has agreed.
    approvals: Vec<DecisionDocument>,
    /// How it ended otherwise.
    closing: Option<DecisionDocument>,
}

impl ProposalDocument {
    pub(super) fn of(proposal: Proposal, revision: Revision) -> Self {
        let approvals = proposal.approvals.into_iter();
        Self {
            id: proposal.id,
            robot: proposal.robot,
            version: proposal.version,
            state: proposal.state,
            proposed_by: proposal.proposed_by,
            reason: proposal.reason,
            created: time::of_ns(proposal.created_ns),
            expires: time::of_ns(proposal.expires_ns),
            revision: RevisionDocument::of(revision),
            base: proposal.base,
            base_generation: proposal.base_generation,
            approvals_needed: proposal.approvals_needed,
            approvals: approvals.map(DecisionDocument::of_approval).collect(),
            closing: proposal.closing.map(DecisionDocument::of_closing),
        }
    }
}

/// Values that a robot compensates with.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = InUse)]
pub(super) struct InUseDocument {
    /// Generation of the document; 0 for what the robot brought along.
    generation: u64,
    /// The revision; absent for what the robot brought along.
    revision: Option<u64>,
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
            since: time::of_ns(in_use.since_ns),
        }
    }
}

/// What a fresh estimate said of the values in use.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Verification)]
struct VerificationDocument {
    #[schema(value_type = String, format = DateTime)]
    at: Timestamp,
    /// Distance driven since the values are in use, m.
    distance_m: f64,
    /// Fresh estimate less values in use: steering offset (rad), LiDAR x (m), y (m), yaw (rad).
    residual: [f64; 4],
    /// Sigmas of the fresh estimate, in the same order.
    sigma: [f64; 4],
    /// Whether the residual is inside its tolerance.
    within: bool,
}

impl VerificationDocument {
    fn of(verification: Verification) -> Self {
        Self {
            at: time::of_ns(verification.at_ns),
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
    id: u64,
    robot: RobotId,
    /// Goes up with every change of it.
    version: u64,
    state: DeploymentState,
    /// The proposal that was approved; absent for a return to an earlier calibration.
    proposal: Option<u64>,
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
            created: time::of_ns(deployment.created_ns),
            expires: time::of_ns(deployment.expires_ns),
            offered: deployment.offered_ns.map(time::of_ns),
            applied: deployment.applied_ns.map(time::of_ns),
            closed: deployment.closed_ns.map(time::of_ns),
            verification: deployment.verification.map(VerificationDocument::of),
            reason: deployment.reason,
        }
    }
}

/// The latest answer of a robot.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Reported)]
struct ReportedDocument {
    generation: u64,
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
            at: time::of_ns(reported.at_ns),
            received: time::of_ns(reported.received_ns),
        }
    }
}

/// Desired and reported state of one robot. Its `ETag` is `version`.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Shadow)]
pub(super) struct ShadowDocument {
    robot: RobotId,
    /// Goes up with every change of it.
    version: u64,
    /// What the robot should hold; absent before the first approval.
    desired: Option<GenerationRef>,
    /// What the robot last answered.
    reported: Option<ReportedDocument>,
    /// Whether the robot holds what it should.
    in_sync: bool,
    /// What the robot uses, as far as it has said.
    in_use: Option<InUseDocument>,
    /// What it used before.
    before: Option<InUseDocument>,
    /// Generations that were verified, oldest first.
    verified: Vec<GenerationRef>,
    /// The proposal that waits.
    proposal: Option<u64>,
    /// The deployment under way.
    deployment: Option<DeploymentDocument>,
}

impl ShadowDocument {
    pub(super) fn of(ledger: &RobotLedger) -> Self {
        let shadow = ledger.shadow.clone();
        Self {
            in_sync: shadow.in_sync(),
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
pub(in crate::api) struct CalibrationSummary {
    /// The generation that the robot should hold; absent before the first approval.
    desired_generation: Option<u64>,
    /// The generation that it uses; 0 for what it brought along, absent when it never said.
    reported_generation: Option<u64>,
    /// Whether the robot holds what it should.
    in_sync: bool,
    /// What the robot compensates with, as far as it has said.
    in_use: Option<CalibrationValues>,
    /// The proposal that waits.
    proposal: Option<u64>,
    /// Where the deployment under way stands.
    deployment: Option<DeploymentState>,
    /// Whether a fresh estimate disagrees with what the robot uses.
    verification_failed: bool,
}

impl CalibrationSummary {
    /// The summary of a robot's records.
    pub(in crate::api) fn of(ledger: &RobotLedger) -> Self {
        let shadow = &ledger.shadow;
        let live = ledger.live.as_ref();
        let verdict = live.and_then(|live| live.verification);
        Self {
            desired_generation: shadow.desired.as_ref().map(|desired| desired.generation),
            reported_generation: shadow.in_use.as_ref().map(|in_use| in_use.generation),
            in_sync: shadow.in_sync(),
            in_use: shadow.in_use.as_ref().map(|in_use| in_use.values),
            proposal: ledger.open.as_ref().map(|open| open.id),
            deployment: live.map(|live| live.state),
            verification_failed: verdict.is_some_and(|verdict| !verdict.within),
        }
    }
}
