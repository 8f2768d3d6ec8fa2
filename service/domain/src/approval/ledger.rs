//! The records of one robot that can still change, and what a step makes of them.

use std::collections::BTreeMap;

use fleetcal_model::{DeploymentId, Generation, ProposalId, RevisionId};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Envelope;

use super::deployment::Deployment;
use super::generation::GenerationRef;
use super::proposal::Proposal;
use super::revision::{Origin, Revision};
use super::shadow::Shadow;
use super::transition::Transition;
use super::values::{Change, difference};

/// The records of one robot that can still change.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotLedger {
    /// Desired and reported state.
    pub shadow: Shadow,
    /// The proposal that waits, if any.
    pub open: Option<Proposal>,
    /// The deployment under way, if any.
    pub live: Option<Deployment>,
    /// The document that a robot's answer is about, which the records above may not name any more.
    pub answered: Option<GenerationRef>,
    /// Every revision that these name.
    pub revisions: BTreeMap<RevisionId, Revision>,
}

impl RobotLedger {
    /// A robot for which nothing was ever proposed.
    pub fn new(robot: RobotId) -> Self {
        Self {
            shadow: Shadow::new(robot),
            open: None,
            live: None,
            answered: None,
            revisions: BTreeMap::new(),
        }
    }

    /// The signed document of a generation, where the records name it.
    pub(super) fn reference(&self, generation: Generation) -> Option<&GenerationRef> {
        let live = self.live.iter();
        let offers = live.flat_map(|live| {
            let earlier = live.earlier.iter().chain(&live.desired_before);
            earlier.chain(std::iter::once(&live.offer))
        });
        let shadow = &self.shadow;
        let named = offers.chain(&shadow.desired).chain(&shadow.verified);
        let mut named = named.chain(&self.answered);
        named.find(|one| one.generation == generation)
    }

    /// True if the robot uses values that were approved for it: neither its factory calibration, even
    /// where that came back to it, nor what a person rolled it back to.
    pub fn uses_approved(&self) -> bool {
        let in_use = self.shadow.in_use.as_ref();
        let Some(in_use) = in_use.filter(|one| !one.generation.is_factory()) else {
            return false;
        };
        let reference = self.reference(in_use.generation);
        let is_chosen = reference.is_some_and(|one| one.chosen_by.is_some());
        let revision = self.revision_in_use();
        !is_chosen && revision.is_none_or(|revision| revision.origin != Origin::Robot)
    }

    /// What the robot uses, where it was approved here.
    pub(super) fn revision_in_use(&self) -> Option<&Revision> {
        self.revisions.get(&self.shadow.in_use.as_ref()?.revision?)
    }

    /// How far a proposal goes from what the robot should use; of a robot for which nothing was
    /// approved yet, from what it uses. What robots say of themselves makes no step smaller.
    pub(super) fn step_of(&self, proposal: &Proposal) -> Option<Change> {
        let to = self.revisions.get(&proposal.revision)?;
        let desired = self.shadow.desired.as_ref();
        let desired = desired.and_then(|one| self.revisions.get(&one.revision));
        let from = desired.map(|one| one.values).or(proposal.base)?;
        Some(difference(&from, &to.values))
    }

    /// The revisions that the records name.
    pub fn named_revisions(&self) -> Vec<RevisionId> {
        let shadow = &self.shadow;
        let mut ids: Vec<RevisionId> = shadow.verified.iter().map(|one| one.revision).collect();
        ids.extend(shadow.desired.iter().map(|one| one.revision));
        ids.extend(shadow.in_use.iter().filter_map(|one| one.revision));
        ids.extend(shadow.before.iter().filter_map(|one| one.revision));
        ids.extend(shadow.declined);
        ids.extend(self.answered.iter().map(|one| one.revision));
        ids.extend(self.open.iter().map(|one| one.revision));
        if let Some(live) = &self.live {
            ids.push(live.offer.revision);
            ids.extend(live.earlier.iter().map(|one| one.revision));
            ids.extend(live.desired_before.iter().map(|one| one.revision));
            ids.extend(live.base.iter().filter_map(|base| base.revision));
        }
        ids.sort_unstable();
        ids.dedup();
        ids
    }
}

/// The numbers that new records get.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NextIds {
    /// Of the next revision.
    pub revision: RevisionId,
    /// Of the next proposal.
    pub proposal: ProposalId,
    /// Of the next deployment.
    pub deployment: DeploymentId,
}

/// Something to be sent to the robot, kept until it was.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum OutboxEntry {
    /// The approved document of this generation.
    Approved(Generation),
    /// That the answer about this generation is stored.
    Confirmed(Generation),
}

/// What a step leaves, to be written in one transaction.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The robot's records afterwards.
    pub ledger: RobotLedger,
    /// Revisions that are new.
    pub revisions: Vec<Revision>,
    /// Proposals that are new or changed.
    pub proposals: Vec<Proposal>,
    /// Deployments that are new or changed.
    pub deployments: Vec<Deployment>,
    /// Whether the shadow changed.
    pub shadow_changed: bool,
    /// Documents that were signed, with their generations.
    pub envelopes: Vec<(Generation, Envelope)>,
    /// What to send.
    pub outbox: Vec<OutboxEntry>,
    /// What was sent and need not be kept any more.
    pub sent: Option<OutboxEntry>,
    /// One for each change of a record.
    pub transitions: Vec<Transition>,
}
