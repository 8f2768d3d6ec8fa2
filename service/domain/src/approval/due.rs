//! Commands that time or a new estimate makes due.

use fleetcal_model::{RevisionId, WallTime};
use fleetcal_proto::calibration::CalibrationValues;
use fleetcal_proto::estimate::EstimateDocument;

use super::ask::within_limits;
use super::command::Command;
use super::deployment::{Deployment, DeploymentState, Verification};
use super::ledger::RobotLedger;
use super::policy::Policy;
use super::present::{Outdated, Present, REFRESH_EVERY_NS, outdated};
use super::proposal::Proposal;
use super::revision::{Evidence, Origin};
use super::values::{added, difference, exceeds, exceeds_significantly, four, values_and_sigmas};

/// State of the robot beside its records.
#[derive(Debug, Clone, Copy)]
pub struct Situation<'a> {
    /// Wall time.
    pub now: WallTime,
    /// Latest estimate, if its vehicle is the one that was calibrated.
    pub estimate: Option<&'a EstimateDocument>,
    /// Reasons for which the estimate may not be of the present vehicle.
    pub objections: Objections,
    /// True if that estimate has been stable for [`Policy::stable_for_s`].
    pub stable: bool,
    /// Verification estimate: from the data since the values in use were applied.
    pub verification: Option<&'a EstimateDocument>,
    /// Values in use of a robot that has never reported them.
    pub nominal: Option<CalibrationValues>,
}

/// Reasons for which an estimate may not be of the present vehicle.
#[derive(Debug, Clone, Copy, Default)]
pub struct Objections {
    /// True if a reassembly was reported, and the calibration is not known again since.
    pub reassembly_open: bool,
    /// True if two senders use the robot's id.
    pub two_senders: bool,
    /// True if the vehicle is no longer the one that was calibrated, and not known again yet.
    pub vehicle_changed: bool,
}

/// Verdict of a verification estimate on the values in use.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// Undecided yet.
    NotYet,
    /// Inside or outside the tolerance at `VERIFY_SIGMAS`.
    Known(Box<Verification>),
}

/// Multiple of the verification estimate's sigma that must fit beside the difference.
///
/// At two, values outside the tolerance pass with a probability of 2.3 % at most, and values inside
/// it fail with the same one: both verdicts follow one rule. One sigma would pass 16 %; three would
/// leave robots verifying whose uncertainty is a third of the tolerance, which is as sharp as the
/// LiDAR's position gets within the first 100 m.
const VERIFY_SIGMAS: f64 = 2.0;

/// Judges the values in use by a verification estimate, each part of the difference `d` with the
/// estimate's `sigma` against the tolerance `T`:
///
/// 1. verified when `|d| + k sigma <= T` for all of them,
/// 2. failed when `|d| - k sigma > T` for one of them,
/// 3. undecided until more motion otherwise; `k` is `VERIFY_SIGMAS`.
pub fn judge(
    in_use: &CalibrationValues,
    verification: &EstimateDocument,
    policy: &Policy,
    now: WallTime,
) -> Verdict {
    let Some((values, sigmas)) = values_and_sigmas(verification) else {
        return Verdict::NotYet;
    };
    if verification.distance_m < policy.verify_after_m {
        return Verdict::NotYet;
    }
    let residual = difference(in_use, &values);
    let sigma = four(&sigmas);
    let limits = policy.verify_within.limits();
    let beyond = |sigmas: f64| {
        let parts = residual.iter().zip(&limits).zip(&sigma);
        parts
            .into_iter()
            .any(|((part, limit), sigma)| part.abs() + sigmas * sigma > *limit)
    };
    let within = !beyond(VERIFY_SIGMAS);
    let outside = beyond(-VERIFY_SIGMAS);
    if !within && !outside {
        return Verdict::NotYet;
    }
    Verdict::Known(Box::new(Verification {
        at_ns: now,
        distance_m: verification.distance_m,
        residual,
        sigma,
        within,
        limits: Some(limits),
        evidence: Some(Evidence::of(verification)),
    }))
}

/// Command that is due, if any. Each changes the records, so that it is due once.
pub fn due(ledger: &RobotLedger, situation: &Situation<'_>, policy: &Policy) -> Option<Command> {
    if ledger.shadow.retired.is_some() {
        return None;
    }
    if let Some(live) = &ledger.live {
        return deployment_due(ledger, live, situation, policy);
    }
    let Some(open) = &ledger.open else {
        return proposal_due(ledger, situation, policy);
    };
    if situation.now >= open.expires_ns {
        return Some(Command::Expire { proposal: open.id });
    }
    brought_up_to_date(ledger, open, situation, policy)
}

impl Situation<'_> {
    /// Present estimate of the robot.
    fn present(&self) -> Present {
        if self.objections.reassembly_open {
            return Present::Reassembled;
        }
        if self.objections.two_senders {
            return Present::TwoSenders;
        }
        if self.objections.vehicle_changed {
            return Present::VehicleChanged;
        }
        match self.estimate.and_then(values_and_sigmas) {
            Some((values, sigmas)) => Present::Known { values, sigmas },
            None => Present::Unknown,
        }
    }
}

/// Refreshes or closes a proposal that the present estimate contradicts, at most once in
/// [`REFRESH_EVERY_NS`], and only by a stable estimate.
fn brought_up_to_date(
    ledger: &RobotLedger,
    open: &Proposal,
    situation: &Situation<'_>,
    policy: &Policy,
) -> Option<Command> {
    let proposal = open.id;
    let proposed = ledger.revisions.get(&open.revision)?;
    let outdated = outdated(proposed, &situation.present())?;
    let close = |reason: String| Some(Command::Supersede { proposal, reason });
    if !matches!(outdated, Outdated::Moved { .. }) {
        return close(outdated.to_string());
    }
    let estimate = situation.estimate?;
    let (values, sigmas) = values_and_sigmas(estimate)?;
    let refreshed_ns = open.refreshed.as_ref().map(|last| last.at_ns);
    let since_ns = refreshed_ns.unwrap_or(open.created_ns);
    if situation.now.ns_since(since_ns) < REFRESH_EVERY_NS || !situation.stable {
        return None;
    }
    let in_use = ledger.shadow.in_use.as_ref().map(|in_use| in_use.values);
    let used = in_use.or(situation.nominal);
    if used.is_some_and(|used| !differs(&used, &values, &sigmas, policy)) {
        return close("the present estimate agrees with what the robot uses".to_owned());
    }
    if let Err(refused) = within_limits(&values, policy) {
        return close(format!("the present estimate is refused: {refused}"));
    }
    Some(Command::Refresh {
        proposal,
        values,
        sigmas,
        evidence: Evidence::of(estimate),
        reason: outdated.to_string(),
    })
}

/// True if an estimate differs from some values by enough, and significantly enough, to be
/// proposed.
fn differs(
    from: &CalibrationValues,
    values: &CalibrationValues,
    sigmas: &CalibrationValues,
    policy: &Policy,
) -> bool {
    let change = difference(from, values);
    let limits = policy.propose_beyond.limits();
    exceeds_significantly(&change, &limits, &four(sigmas), policy.propose_sigmas)
}

/// Automatic approval of an open proposal, if the policy permits it.
pub fn automatic(ledger: &RobotLedger, policy: &Policy) -> Option<Command> {
    let within = policy.approve_within?;
    let open = ledger.open.as_ref()?;
    let revision = ledger.revisions.get(&open.revision)?;
    let limits = within.limits();
    let step = difference(open.base.as_ref()?, &revision.values);
    // Many small steps go as far as a large one, which a person would have looked at.
    let sum = added(&ledger.shadow.automatic_sum, &ledger.step_of(open)?);
    let small = !exceeds(&step, &limits) && !exceeds(&sum, &limits);
    let ours = revision.origin == Origin::Estimator && open.approvals_needed == 1;
    let in_use = ledger.revision_in_use();
    let frame = in_use.and_then(|in_use| in_use.rear_axle_in_base_link);
    let same_frame = frame == revision.rear_axle_in_base_link;
    let desired = ledger.shadow.desired.as_ref();
    let chosen = desired.is_some_and(|desired| desired.chosen_by.is_some());
    // Somebody else may have answered in the robot's name: then nobody knows what it uses.
    // And a drawing that somebody gave is one person's word.
    let for_people = chosen || ledger.shadow.contradicted.is_some() || open.drawn_by.is_some();
    (small && ours && same_frame && !for_people && ledger.live.is_none()).then(|| {
        Command::Approve {
            proposal: open.id,
            version: Some(open.version),
            sha256: open.revision_sha256.clone(),
            reason: Some(
                "the change is inside approval.approve_within, with those since a person approved"
                    .to_owned(),
            ),
        }
    })
}

fn deployment_due(
    ledger: &RobotLedger,
    live: &Deployment,
    situation: &Situation<'_>,
    policy: &Policy,
) -> Option<Command> {
    let deployment = live.id;
    let give_up = |reason: &str| {
        Some(Command::GiveUp {
            deployment,
            reason: reason.to_owned(),
        })
    };
    match live.state {
        DeploymentState::Queued | DeploymentState::Offered => {
            if situation.now >= live.expires_ns {
                return give_up("the robot did not take it in time");
            }
            // What goes back to an earlier calibration was not estimated now.
            live.proposal?;
            let reason = disagreement(ledger, live.offer.revision, situation, policy)?;
            Some(Command::Void { deployment, reason })
        }
        DeploymentState::RollingBack if situation.now >= live.expires_ns => {
            give_up("the robot did not take its former values in time")
        }
        DeploymentState::Verifying => verification_due(ledger, live, situation, policy),
        _ => None,
    }
}

fn verification_due(
    ledger: &RobotLedger,
    live: &Deployment,
    situation: &Situation<'_>,
    policy: &Policy,
) -> Option<Command> {
    let deployment = live.id;
    let in_use = ledger.shadow.in_use.as_ref()?;
    let judged = situation
        .verification
        .map(|verification| judge(&in_use.values, verification, policy, situation.now));
    let verdict_before = live.verification.as_ref();
    let failed_before = verdict_before.is_some_and(|verdict| !verdict.within);
    if let Some(Verdict::Known(verification)) = judged
        && (verification.within || !failed_before)
    {
        return Some(Command::Judge {
            deployment,
            verification: *verification,
        });
    }
    let since_ns = live.applied_ns.unwrap_or(live.created_ns);
    let given_ns = i64::from(policy.verify_within_s).saturating_mul(1_000_000_000);
    let reason = if failed_before {
        "a verification estimate disagreed with it, and nobody decided in time"
    } else {
        "the robot has not moved enough to tell"
    };
    (situation.now.ns_since(since_ns) >= given_ns).then(|| Command::GiveUp {
        deployment,
        reason: reason.to_owned(),
    })
}

/// Reason for which the latest estimate contradicts a revision of the estimator's.
fn disagreement(
    ledger: &RobotLedger,
    revision: RevisionId,
    situation: &Situation<'_>,
    policy: &Policy,
) -> Option<String> {
    if situation.objections.reassembly_open {
        return Some(Outdated::Reassembled.to_string());
    }
    let revision = ledger.revisions.get(&revision)?;
    if revision.origin != Origin::Estimator {
        return None;
    }
    if situation.objections.two_senders {
        return Some(Outdated::TwoSenders.to_string());
    }
    let (values, sigmas) = values_and_sigmas(situation.estimate?)?;
    differs(&revision.values, &values, &sigmas, policy)
        .then(|| "a newer estimate disagrees with it".to_owned())
}

fn proposal_due(
    ledger: &RobotLedger,
    situation: &Situation<'_>,
    policy: &Policy,
) -> Option<Command> {
    let is_unsettled = situation.objections.reassembly_open || situation.objections.two_senders;
    if !policy.propose || !situation.stable || is_unsettled {
        return None;
    }
    let estimate = situation.estimate?;
    let (values, sigmas) = values_and_sigmas(estimate)?;
    let differs = |from: &CalibrationValues| differs(from, &values, &sigmas, policy);
    let in_use = ledger.shadow.in_use.as_ref().map(|in_use| in_use.values);
    if in_use
        .or(situation.nominal)
        .is_some_and(|used| !differs(&used))
    {
        return None;
    }
    let declined = ledger.shadow.declined;
    let declined = declined.and_then(|id| ledger.revisions.get(&id));
    if declined.is_some_and(|revision| !differs(&revision.values)) {
        return None;
    }
    Some(Command::Propose {
        origin: Origin::Estimator,
        values,
        sigmas,
        evidence: Evidence::of(estimate),
        reason: None,
    })
}
