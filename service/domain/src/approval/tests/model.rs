//! Model of one robot's records, which follows each step's outcome and reports errors.

use std::collections::{BTreeMap, BTreeSet};

use fleetcal_model::{DeploymentId, Generation, ProposalId, RevisionId, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{Applied, AppliedStatus, CalibrationValues, Envelope};
use fleetcal_proto::signing::TrustedKeys;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::access::{Actor, Authentication};
use crate::approval::{
    Command, Deployment, DeploymentState, Drawing, GenerationRef, NextIds, Origin, OutboxEntry,
    Outcome, Policy, Proposal, ProposalState, Revision, RobotLedger, Shadow, Transition, audited,
    difference,
};

/// Name under which the service itself acts.
const SERVICE: &str = "fleetcal";

/// Generation and values in use, as reported by the robot; `None` if unknown.
type Used = Option<(Generation, CalibrationValues)>;

/// Every record that one robot ever had, and the facts known from outside.
#[derive(Debug)]
pub struct Model {
    /// Records that the store would read before the next step.
    pub ledger: RobotLedger,
    /// Every signed document by generation.
    pub envelopes: BTreeMap<Generation, Envelope>,
    revisions: BTreeMap<RevisionId, Revision>,
    proposals: BTreeMap<ProposalId, Proposal>,
    deployments: BTreeMap<DeploymentId, Deployment>,
    /// Last `after` of every record in the audit.
    audited: BTreeMap<(&'static str, String), Value>,
    /// Entries of the outbox, one of each kind.
    outbox: BTreeMap<&'static str, OutboxEntry>,
    /// Configured drawing of the robot.
    pub drawing: Option<Drawing>,
    used: Used,
    used_before: Used,
    /// Highest generation that the robot has named.
    heard: Generation,
    trusted: TrustedKeys,
    policy: Policy,
}

impl Model {
    pub fn new(robot: RobotId, trusted: TrustedKeys, policy: Policy) -> Self {
        Self {
            ledger: RobotLedger::new(robot),
            envelopes: BTreeMap::new(),
            revisions: BTreeMap::new(),
            proposals: BTreeMap::new(),
            deployments: BTreeMap::new(),
            audited: BTreeMap::new(),
            outbox: BTreeMap::new(),
            drawing: None,
            used: None,
            used_before: None,
            heard: Generation(0),
            trusted,
            policy,
        }
    }

    /// Records as the store reads them for `command`.
    pub fn read_for(&self, command: &Command) -> RobotLedger {
        let mut ledger = self.ledger.clone();
        if let Command::Acknowledge(applied) = command
            && let Some(envelope) = self.envelopes.get(&applied.generation)
        {
            let revision = envelope.open(&self.trusted).unwrap().revision;
            ledger.answered = Some(GenerationRef {
                generation: applied.generation,
                sha256: envelope.sha256.clone(),
                revision,
                chosen_by: None,
            });
            let known = self.revisions[&revision].clone();
            ledger.revisions.insert(revision, known);
        }
        ledger
    }

    pub fn next_ids(&self) -> NextIds {
        let revision = self.revisions.keys().next_back().copied();
        let proposal = self.proposals.keys().next_back().copied();
        let deployment = self.deployments.keys().next_back().copied();
        NextIds {
            revision: revision.unwrap_or_default().next(),
            proposal: proposal.unwrap_or_default().next(),
            deployment: deployment.unwrap_or_default().next(),
        }
    }

    /// Applies the outcome of `command` at `now`, and checks all of it.
    pub fn take(&mut self, command: &Command, actor: &Actor, outcome: &Outcome, now: WallTime) {
        self.check_choice(command, actor, outcome);
        if let Command::Acknowledge(applied) = command {
            self.heard = self.heard.max(Generation(applied.generation.0));
        }
        self.take_audit(outcome);
        self.take_revisions(outcome);
        self.take_proposals(outcome, now);
        self.take_deployments(outcome);
        self.take_envelopes(outcome);
        self.take_outbox(outcome);
        if let Command::Acknowledge(applied) = command {
            self.take_answer(applied, outcome);
        }
        self.check_shadow(&outcome.ledger.shadow);
        self.check_live(&outcome.ledger);
        self.reload(outcome);
    }

    /// Checks that a person's choice stands until a person, or the robot itself, replaces it; and
    /// that the deployment keeps who chose it, why, and the restored values.
    fn check_choice(&self, command: &Command, actor: &Actor, outcome: &Outcome) {
        if matches!(command, Command::RollBack { .. }) {
            let asked = outcome.deployments.iter().rev().find_map(|one| {
                let asked = one.roll_back.as_ref().filter(|_| one.state.is_live())?;
                Some((asked, &one.offer))
            });
            if let Some((asked, offer)) = asked {
                assert!(!asked.automatic);
                assert_eq!(
                    (Some(&asked.by), &asked.by),
                    (offer.chosen_by.as_ref(), &actor.name)
                );
                assert_eq!(
                    asked.values,
                    outcome.ledger.revisions[&offer.revision].values
                );
            }
            return;
        }
        for after in &outcome.deployments {
            let before = self.deployments.get(&after.id);
            let asked = before.and_then(|before| before.roll_back.as_ref());
            if let Some(asked) = asked.filter(|asked| !asked.automatic) {
                assert_eq!(after.roll_back.as_ref(), Some(asked), "{command:?}");
            }
        }
        let chosen = self.ledger.shadow.desired.as_ref();
        let chosen = chosen.filter(|one| one.chosen_by.is_some());
        let of_the_service = match command {
            Command::Judge { .. } | Command::Void { .. } | Command::GiveUp { .. } => true,
            Command::Approve { .. } => actor.authentication == Authentication::Service,
            _ => false,
        };
        if chosen.is_some() && of_the_service {
            assert_eq!(
                outcome.ledger.shadow.desired.as_ref(),
                chosen,
                "{command:?}"
            );
            let live = outcome.ledger.live.as_ref();
            assert!(live.is_none_or(|live| live.state != DeploymentState::RollingBack));
        }
    }

    /// Checks that every changed record has its rows, and every row its change.
    fn take_audit(&mut self, outcome: &Outcome) {
        for transition in &outcome.transitions {
            let record = (transition.action().subject(), transition.subject_id());
            let unborn = matches!(transition, Transition::Shadow(_))
                .then(|| serde_json::to_value(&self.ledger.shadow).unwrap());
            let before = self.audited.get(&record).cloned().or(unborn);
            let (stood, after) = audited(transition);
            assert_eq!(stood, before, "before, {:?}", transition.action());
            let version = |record: &Value| record["version"].as_u64().unwrap();
            let earlier = before.as_ref().map_or(0, version);
            assert_eq!(version(&after), earlier + 1, "a version each");
            assert_ne!(Some(&after), before.as_ref(), "a change each");
            self.audited.insert(record, after);
        }
        let last_audited = |subject, id: String| self.audited.get(&(subject, id));
        for proposal in &outcome.proposals {
            let id = proposal.id.to_string();
            assert_eq!(
                last_audited("proposal", id),
                Some(&there_and_back(proposal))
            );
        }
        for deployment in &outcome.deployments {
            let last = outcome
                .deployments
                .iter()
                .rfind(|one| one.id == deployment.id);
            let id = deployment.id.to_string();
            assert_eq!(
                last_audited("deployment", id),
                Some(&there_and_back(last.unwrap()))
            );
        }
        let shadow = &outcome.ledger.shadow;
        let changed = *shadow != self.ledger.shadow;
        assert_eq!(outcome.shadow_changed, changed, "{:?}", outcome.transitions);
        if changed {
            let id = shadow.robot.to_string();
            assert_eq!(last_audited("shadow", id), Some(&there_and_back(shadow)));
        }
    }

    fn take_revisions(&mut self, outcome: &Outcome) {
        for revision in &outcome.revisions {
            assert_eq!(revision.sha256, revision.hash());
            there_and_back(revision);
            let earlier = self.revisions.insert(revision.id, revision.clone());
            assert!(earlier.is_none(), "a revision is never changed");
        }
    }

    fn take_proposals(&mut self, outcome: &Outcome, now: WallTime) {
        for proposal in &outcome.proposals {
            let before = self
                .proposals
                .insert(ProposalId(proposal.id.0), proposal.clone());
            let open = |one: Proposal| one.state == ProposalState::Proposed;
            assert!(before.is_none_or(open), "a decided proposal stays decided");
            let revision = &self.revisions[&proposal.revision];
            assert_eq!(proposal.revision_sha256, revision.sha256);
            let by: BTreeSet<_> = proposal.approvals.iter().map(|one| &one.by).collect();
            assert_eq!(by.len(), proposal.approvals.len(), "one person counts once");
            let own = by.contains(&proposal.proposed_by) && proposal.proposed_by != SERVICE;
            assert!(!own, "nobody approves what he proposed");
            for approval in &proposal.approvals {
                assert_eq!(approval.sha256, revision.sha256);
                assert!(approval.at_ns < proposal.expires_ns, "approved too late");
            }
            let enough = by.len() >= proposal.approvals_needed as usize;
            assert_eq!(proposal.state == ProposalState::Approved, enough);
            if proposal.state == ProposalState::Approved {
                assert_eq!(proposal.approvals.last().unwrap().at_ns, now);
                if by.len() < 2 {
                    self.check_one_is_enough(proposal, revision);
                }
            }
        }
    }

    /// Checks that one person approves only changes near to all values that the robot may use by
    /// the statement of others than who proposed and who approved; and that there is such a
    /// statement.
    fn check_one_is_enough(&self, proposal: &Proposal, revision: &Revision) {
        let near = |from: &CalibrationValues| {
            let change = difference(from, &revision.values);
            let parts = change.iter().zip(self.policy.two_approvers_beyond.limits());
            parts.into_iter().all(|(part, limit)| part.abs() <= limit)
        };
        assert!(self.used.is_none_or(|(_, values)| near(&values)));
        let shadow = &self.ledger.shadow;
        let approved = shadow.desired.iter();
        let approved = approved.filter(|one| self.revisions[&one.revision].origin != Origin::Robot);
        let mut vouched = approved.chain(shadow.verified.iter().rev());
        if let Some(vouched) = vouched.next() {
            let vouched = &self.revisions[&vouched.revision];
            assert!(
                near(&vouched.values),
                "near to what was approved: {vouched:?}"
            );
            return;
        }
        let drawing = self.drawing.as_ref().expect("a drawing");
        assert!(near(&drawing.values), "near to the drawing");
        let approver = proposal.approvals.first().map(|one| one.by.as_str());
        for by in [Some(proposal.proposed_by.as_str()), approver] {
            assert!(drawing.by.is_none() || drawing.by.as_deref() != by);
            assert!(proposal.drawn_by.is_none() || proposal.drawn_by.as_deref() != by);
        }
    }

    fn take_deployments(&mut self, outcome: &Outcome) {
        for deployment in &outcome.deployments {
            let before = self
                .deployments
                .insert(DeploymentId(deployment.id.0), deployment.clone());
            let was_live = before.is_none_or(|one| one.state.is_live());
            assert!(was_live, "an ended deployment stays ended");
            let closed = deployment.closed_ns.is_some();
            assert_ne!(deployment.state.is_live(), closed);
        }
        let live: Vec<_> = self
            .deployments
            .values()
            .filter(|one| one.state.is_live())
            .collect();
        assert!(live.len() <= 1, "one deployment at a time");
        assert_eq!(live.first().copied(), outcome.ledger.live.as_ref());
        let open = |one: &&Proposal| one.state == ProposalState::Proposed;
        let open: Vec<_> = self.proposals.values().filter(open).collect();
        assert!(open.len() <= 1, "one open proposal at a time");
        assert_eq!(open.first().copied(), outcome.ledger.open.as_ref());
        for proposal in self.proposals.values() {
            let brought = self.deployments.values();
            let brought = brought.filter(|one| one.proposal == Some(proposal.id));
            let approved = proposal.state == ProposalState::Approved;
            assert_eq!(brought.count(), usize::from(approved), "{proposal:?}");
        }
    }

    /// Checks that every signed document is new, higher than all before, and equal to its revision.
    fn take_envelopes(&mut self, outcome: &Outcome) {
        for (generation, envelope) in &outcome.envelopes {
            let last = self.envelopes.keys().next_back().copied();
            assert!(last.is_none_or(|last| last < *generation));
            let document = envelope.open(&self.trusted).unwrap();
            assert_eq!(document.generation, *generation);
            let revision = &self.revisions[&document.revision];
            assert_eq!(
                (document.values, document.sigmas),
                (revision.values, revision.sigmas)
            );
            self.envelopes.insert(*generation, envelope.clone());
        }
        let last = self
            .envelopes
            .keys()
            .next_back()
            .copied()
            .unwrap_or(Generation(0));
        let highest = last.max(self.heard);
        assert_eq!(outcome.ledger.shadow.generation_last, highest);
    }

    fn take_outbox(&mut self, outcome: &Outcome) {
        if let Some(sent) = outcome.sent {
            self.outbox.retain(|_, entry| *entry != sent);
        }
        for entry in &outcome.outbox {
            let kind = match entry {
                OutboxEntry::Approved(_) => "approved",
                OutboxEntry::Confirmed(_) => "confirmed",
            };
            self.outbox.insert(kind, *entry);
        }
        let signed = outcome.envelopes.iter().map(|(generation, _)| *generation);
        for generation in signed {
            assert!(outcome.outbox.contains(&OutboxEntry::Approved(generation)));
        }
    }

    /// Follows the robot, which keeps what it applied and remembers what it used before.
    fn take_answer(&mut self, applied: &Applied, outcome: &Outcome) {
        let generation = applied.generation;
        let in_use = self
            .used
            .as_ref()
            .is_some_and(|(used, _)| *used == generation);
        match applied.status {
            AppliedStatus::Applied => {
                let known = self.envelopes.get(&generation);
                let known = known.map(|envelope| envelope.open(&self.trusted).unwrap().values);
                let brought = self.used.filter(|_| in_use).map(|(_, values)| values);
                let values = applied.values.or(known).or(brought);
                if !in_use {
                    self.used_before = self.used.take();
                }
                self.used = values.map(|values| (generation, values));
            }
            AppliedStatus::Reverted if in_use => {
                let before = self.used_before.take();
                let values = applied.values.or(before.map(|(_, values)| values));
                self.used = values.map(|values| {
                    (
                        before.map_or(Generation::FACTORY, |(used, _)| Generation(used.0)),
                        values,
                    )
                });
            }
            _ => {}
        }
        let shadow = &outcome.ledger.shadow;
        let believed = shadow
            .in_use
            .as_ref()
            .map(|one| (one.generation, one.values));
        assert_eq!(believed, self.used, "what the robot uses after {applied:?}");
        let desired = self
            .ledger
            .shadow
            .desired
            .as_ref()
            .map(|one| one.generation);
        let kept = outcome.outbox.contains(&OutboxEntry::Confirmed(generation));
        if kept && applied.status == AppliedStatus::Applied {
            assert_eq!(
                Some(generation),
                desired,
                "only what is wanted is confirmed"
            );
        }
        let revision = shadow.in_use.as_ref().and_then(|one| one.revision);
        if let Some(revision) = revision {
            assert!(self.revisions.contains_key(&revision));
        }
    }

    /// Checks that the desired calibration follows from the deployments.
    fn check_shadow(&self, shadow: &Shadow) {
        use DeploymentState as S;
        let last = self.deployments.values().next_back();
        let desired: Option<&GenerationRef> = last.and_then(|last| match last.state {
            S::TimedOut if last.is_return() => Some(&last.offer),
            S::Refused | S::Failed | S::TimedOut | S::Withdrawn => last.desired_before.as_ref(),
            _ => Some(&last.offer),
        });
        assert_eq!(shadow.desired.as_ref(), desired);
        let references = shadow.desired.iter().chain(&shadow.verified);
        for reference in references {
            let envelope = &self.envelopes[&reference.generation];
            assert_eq!(envelope.sha256, reference.sha256);
            let document = envelope.open(&self.trusted).unwrap();
            assert_eq!(document.revision, reference.revision);
        }
        assert!(shadow.verified.len() <= Shadow::VERIFIED_MAX);
    }

    /// Checks that the outbox has every message that must reach the robot.
    fn check_live(&self, ledger: &RobotLedger) {
        let Some(live) = &ledger.live else { return };
        let generation = live.offer.generation;
        match live.state {
            DeploymentState::Queued => {
                let waiting = self.outbox.get("approved");
                assert_eq!(waiting, Some(&OutboxEntry::Approved(generation)));
            }
            DeploymentState::Applied => {
                let waiting = self.outbox.get("confirmed");
                assert_eq!(waiting, Some(&OutboxEntry::Confirmed(generation)));
            }
            _ => {}
        }
    }

    /// Reads the records back as the store does: with only the revisions that they name.
    fn reload(&mut self, outcome: &Outcome) {
        self.ledger = outcome.ledger.clone();
        let named = self.ledger.named_revisions();
        let revisions = named
            .into_iter()
            .map(|id| (id, self.revisions[&id].clone()));
        self.ledger.revisions = revisions.collect();
    }
}

/// Round trip of a record through JSON.
fn there_and_back<T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(
    record: &T,
) -> Value {
    let json = serde_json::to_value(record).unwrap();
    let text = serde_json::to_string(record).unwrap();
    assert_eq!(serde_json::from_str::<T>(&text).unwrap(), *record);
    json
}
