//! Documents of roll-outs.

use fleetcal_domain::approval::{DeploymentState, Present, ProposalState, RobotLedger, outdated};
use fleetcal_domain::timestamp as time;
use fleetcal_model::{DeploymentId, ProposalId, RevisionId, RolloutId, Version};
use fleetcal_proto::RobotId;
use fleetcal_rollout::{Counts, Followed, Lost, Member, Rollout, RolloutState, Stage, WavePlan};
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

/// Roll-out to plan or to start.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RolloutRequest {
    /// Query for the robots, such as `site:hamburg`; all robots unless given.
    #[serde(default)]
    #[schema(max_length = 2000)]
    pub q: Option<String>,
    /// Waves, 1 to 20.
    pub waves: Vec<WavePlan>,
    /// Hash `sha256` of the plan that the person read; required to start.
    #[serde(default)]
    pub plan: Option<String>,
    /// Reason for the approvals, at most 1000 characters.
    #[serde(default)]
    #[schema(max_length = 1000)]
    pub reason: Option<String>,
}

/// Continuation of a paused or halted roll-out.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(as = RolloutResumption)]
#[serde(deny_unknown_fields)]
pub struct ResumeRequest {
    /// Reason, 1 to 1000 characters.
    #[schema(min_length = 1, max_length = 1000)]
    pub reason: String,
    /// Lost robots of each wave that the person read and accepts, after a halt; none unless given.
    #[serde(default)]
    pub lost: Vec<Lost>,
}

/// Page of roll-outs, newest first.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct RolloutPage {
    /// Roll-outs without their robots.
    pub items: Vec<RolloutDocument>,
    /// Value of `cursor` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next: Option<String>,
}

/// Staged deployment of the proposals that were pending at its start. Its `ETag` is `version`.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Rollout)]
pub struct RolloutDocument {
    /// Number of the roll-out.
    id: RolloutId,
    /// Version, incremented with every change.
    version: Version,
    /// State of the roll-out.
    state: RolloutState,
    /// Query that selected the robots.
    q: String,
    /// Person or token that started it, and approves for its robots.
    started_by: String,
    /// Reason for the approvals.
    reason: Option<String>,
    #[schema(value_type = String, format = DateTime)]
    created: Timestamp,
    /// Latest change.
    changed: ChangeDocument,
    /// Waves, in their order.
    waves: Vec<WaveDocument>,
    /// Robots by wave and id; absent in lists.
    #[serde(skip_serializing_if = "Option::is_none")]
    robots: Option<Vec<RolloutRobotDocument>>,
}

/// Latest change of a roll-out.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = RolloutChange)]
struct ChangeDocument {
    /// Person or token, or the service.
    by: String,
    #[schema(value_type = String, format = DateTime)]
    at: Timestamp,
    /// Reason for the change, in words.
    reason: Option<String>,
}

/// Wave of a roll-out.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = RolloutWave)]
struct WaveDocument {
    /// Plan of the wave.
    plan: WavePlan,
    /// Number of its robots.
    robots: u32,
    /// Number of robots that must be verified before the next wave begins; those that a person
    /// accepted as lost count for neither.
    needed: u32,
    /// Number of robots that may fail, at least those that a person accepted.
    allowed: u32,
    /// Time of its begin; `null` before it.
    #[schema(value_type = Option<String>, format = DateTime)]
    begun: Option<Timestamp>,
    /// Robots by stage; absent in lists.
    #[serde(skip_serializing_if = "Option::is_none")]
    counts: Option<Counts>,
}

/// Robot of a roll-out.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = RolloutRobot)]
struct RolloutRobotDocument {
    robot: RobotId,
    /// Number of its wave, from 1.
    wave: u32,
    /// Stage of the robot.
    stage: Stage,
    /// Approved proposal.
    proposal: ProposalId,
    /// State of the proposal.
    proposal_state: ProposalState,
    /// Deployment of the proposal, once it is approved.
    deployment: Option<DeploymentId>,
    /// State of the deployment, after returns to earlier values.
    deployment_state: Option<DeploymentState>,
    /// Reason for the deployment's state, or against the approval of a released robot.
    reason: Option<String>,
}

/// Reason against the approval of a released robot.
type Against<'a> = &'a dyn Fn(&Member) -> Option<String>;

impl RolloutDocument {
    /// Makes the document of a roll-out for a list.
    pub fn listed(rollout: Rollout) -> Self {
        Self::of(rollout, None)
    }

    /// Makes the document of a roll-out with its robots; `against` has the reason against the
    /// approval of a released robot.
    pub fn shown(rollout: Rollout, robots: &[Followed], against: Against<'_>) -> Self {
        Self::of(rollout, Some((robots, against)))
    }

    fn of(rollout: Rollout, robots: Option<(&[Followed], Against<'_>)>) -> Self {
        let counts = robots.map(|(robots, _)| rollout.counts(robots));
        let counts = |index: usize| counts.as_ref()?.get(index).copied();
        let waves = rollout.waves.iter().enumerate();
        let waves = waves.map(|(index, wave)| WaveDocument {
            plan: wave.plan.clone(),
            robots: wave.robots,
            needed: wave.needed(),
            allowed: wave.allowed(),
            begun: wave.begun_ns.map(time::of),
            counts: counts(index),
        });
        let waves = waves.collect();
        let robots = robots.map(|(robots, against)| {
            let robot = |one: &Followed| RolloutRobotDocument::of(one, &rollout, against);
            robots.iter().map(robot).collect()
        });
        Self {
            waves,
            robots,
            id: rollout.id,
            version: rollout.version,
            state: rollout.state,
            q: rollout.q,
            started_by: rollout.approver.name,
            reason: rollout.reason,
            created: time::of(rollout.created_ns),
            changed: ChangeDocument {
                by: rollout.changed.by,
                at: time::of(rollout.changed.at_ns),
                reason: rollout.changed.reason,
            },
        }
    }
}

impl RolloutRobotDocument {
    fn of(one: &Followed, rollout: &Rollout, against: Against<'_>) -> Self {
        let brought = one.brought.as_ref();
        let stage = one.stage(rollout.has_begun(one.member.wave));
        let reason = match stage {
            Stage::Released => against(&one.member),
            _ => brought.and_then(|brought| brought.reason.clone()),
        };
        Self {
            robot: one.member.robot.clone(),
            wave: one.member.wave,
            stage,
            proposal: one.member.proposal,
            proposal_state: one.proposal_state,
            deployment: brought.map(|brought| brought.deployment),
            deployment_state: brought.map(|brought| brought.state),
            reason,
        }
    }
}

/// Roll-out that would be started.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = RolloutPlan)]
pub struct PlanDocument {
    /// Query as the service writes it.
    pub q: String,
    /// Hash (SHA-256) of the waves' plans, robots, proposals and revisions; the start binds to it.
    pub sha256: String,
    /// Waves, in their order; those without robots are dropped.
    pub waves: Vec<PlannedWave>,
    /// Robots with a pending proposal that is not rolled out.
    pub left_out: Vec<LeftOutDocument>,
}

/// Wave that would be made.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct PlannedWave {
    /// Plan of the wave.
    pub plan: WavePlan,
    /// Number of robots that must be verified before the next wave begins.
    pub needed: u32,
    /// Number of robots that may fail.
    pub allowed: u32,
    /// Its robots.
    pub robots: Vec<PlannedRobot>,
}

/// Robot that would be rolled out.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct PlannedRobot {
    /// The robot.
    pub robot: RobotId,
    /// Its pending proposal.
    pub proposal: ProposalId,
    /// Proposed revision.
    pub revision: RevisionId,
    /// True if another person has to approve it as well.
    pub second_approver: bool,
}

/// Robot with a pending proposal that is not rolled out.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = LeftOutOfRollout)]
pub struct LeftOutDocument {
    /// The robot.
    pub robot: RobotId,
    /// Its pending proposal.
    pub proposal: ProposalId,
    /// Reason, in words.
    pub reason: String,
}

impl LeftOutDocument {
    /// Document of a robot whose open proposal `approver` cannot roll out, with its present
    /// estimate; `other` is a roll-out that has the proposal already. `None` for a robot that can
    /// be rolled out, and for one without an open proposal.
    pub fn of(
        ledger: &RobotLedger,
        present: &Present,
        (approver, other): (&str, Option<RolloutId>),
    ) -> Option<Self> {
        let open = ledger.open.as_ref()?;
        let reason = match other {
            Some(other) => format!("roll-out {other} has it"),
            None => against(ledger, present, approver)?,
        };
        Some(Self {
            robot: open.robot.clone(),
            proposal: open.id,
            reason,
        })
    }
}

/// Reason against an approval of a robot's open proposal by `approver`, in words, with its present
/// estimate; `None` for a robot without one.
pub fn against(ledger: &RobotLedger, present: &Present, approver: &str) -> Option<String> {
    let open = ledger.open.as_ref()?;
    if open.proposed_by == approver {
        return Some(format!(
            "{approver} has proposed it, and somebody else has to approve it"
        ));
    }
    if open.approvals.iter().any(|one| one.by == approver) {
        return Some(format!(
            "{approver} has approved it already, and a second person has to"
        ));
    }
    if let Some(live) = &ledger.live {
        let state = live.state.as_str();
        return Some(format!("deployment {} of the robot is {state}", live.id));
    }
    let revision = ledger.revisions.get(&open.revision)?;
    outdated(revision, present).map(|outdated| outdated.to_string())
}
