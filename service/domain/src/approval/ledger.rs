//! Records of one robot that can still change, and the outcome of a step on them.

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

/// Records of one robot that can still change.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotLedger {
    /// Desired and reported state.
    pub shadow: Shadow,
    /// Open proposal, if any.
    pub open: Option<Proposal>,
    /// The deployment under way, if any.
    pub live: Option<Deployment>,
    /// Document of a robot's answer, which the records above may no longer name.
    pub answered: Option<GenerationRef>,
    /// Every revision that these records name.
    pub revisions: BTreeMap<RevisionId, Revision>,
}

impl RobotLedger {
    /// Records of a robot for which nothing was ever proposed.
    pub fn new(robot: RobotId) -> Self {
        Self {
            shadow: Shadow::new(robot),
            open: None,
            live: None,
            answered: None,
            revisions: BTreeMap::new(),
        }
    }

    /// Signed document of a generation, if the records name it.
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

    /// True if the robot uses values approved for it: neither its factory calibration, even if
    /// restored, nor values that a person rolled it back to.
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

    /// Revision in use, if it was approved here.
    pub(super) fn revision_in_use(&self) -> Option<&Revision> {
        self.revisions.get(&self.shadow.in_use.as_ref()?.revision?)
    }

    /// Step of a proposal from the desired values; before any approval, from the values in use.
    /// Values that robots report of themselves make no step smaller.
    pub(super) fn step_of(&self, proposal: &Proposal) -> Option<Change> {
        let to = self.revisions.get(&proposal.revision)?;
        let desired = self.shadow.desired.as_ref();
        let desired = desired.and_then(|one| self.revisions.get(&one.revision));
        let from = desired.map(|one| one.values).or(proposal.base)?;
        Some(difference(&from, &to.values))
    }

    /// Revisions that the records name.
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

/// Numbers of the next records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NextIds {
    /// Number of the next revision.
    pub revision: RevisionId,
    /// Number of the next proposal.
    pub proposal: ProposalId,
    /// Number of the next deployment.
    pub deployment: DeploymentId,
}

/// Message to the robot, kept until it is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum OutboxEntry {
    /// Approved document of this generation.
    Approved(Generation),
    /// Confirmation that the answer about this generation is stored.
    Confirmed(Generation),
}

/// Outcome of a step, to be written in one transaction.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Records of the robot afterwards.
    pub ledger: RobotLedger,
    /// New revisions.
    pub revisions: Vec<Revision>,
    /// New or changed proposals.
    pub proposals: Vec<Proposal>,
    /// New or changed deployments.
    pub deployments: Vec<Deployment>,
    /// True if the shadow changed.
    pub shadow_changed: bool,
    /// Signed documents, with their generations.
    pub envelopes: Vec<(Generation, Envelope)>,
    /// Messages to send.
    pub outbox: Vec<OutboxEntry>,
    /// Message that was sent and need not be kept.
    pub sent: Option<OutboxEntry>,
    /// Transitions, one for each change of a record.
    pub transitions: Vec<Transition>,
}
