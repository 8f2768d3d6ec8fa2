//! Answers of the agent, and their repetition.

use std::time::Duration;

use fleetcal_model::{Generation, RobotTime};
use fleetcal_proto::calibration::{Applied, AppliedStatus, Envelope};

use super::Agent;
use crate::agent::event::Effect;
use crate::agent::offer::Refusal;
use crate::agent::state::{Phase, Rest};

/// Interval at which an unconfirmed acknowledgement is repeated while the deadline runs.
const REPEAT_URGENT: Duration = Duration::from_secs(5);
/// Interval at which it is repeated otherwise.
const REPEAT: Duration = Duration::from_mins(1);
/// Least interval of the same refusal of a document that leaves no trace.
const SAME_REFUSAL: Duration = Duration::from_secs(30);
/// Most acknowledgements that wait for confirmation; the oldest is dropped first.
const UNSTORED_MAX: usize = 4;

impl Agent {
    /// Handles an offer of a decided document: unless the robot holds it, the service has not
    /// received the decision.
    pub(super) fn remind(&mut self, envelope: &Envelope, now: RobotTime) -> Vec<Effect> {
        let latest = self.memory.latest.as_ref();
        let about_it = latest.filter(|latest| latest.sha256 == envelope.sha256);
        match about_it {
            Some(latest) if !self.memory.held.is(latest.generation, &latest.sha256) => {
                let effect = Effect::Acknowledge(latest.clone());
                self.repeat_at_ns = now.plus(self.repeat_pause());
                vec![effect]
            }
            _ => Vec::new(),
        }
    }

    /// Refuses a document that leaves no trace.
    pub(super) fn refuse(&mut self, refusal: Refusal, now: RobotTime) -> Vec<Effect> {
        let said = self
            .last_refusal
            .as_ref()
            .is_some_and(|(last, at_ns)| *last == refusal && now < at_ns.plus(SAME_REFUSAL));
        if said {
            return Vec::new();
        }
        self.last_refusal = Some((refusal.clone(), now));
        vec![Effect::Acknowledge(Applied {
            generation: refusal.generation,
            sha256: refusal.sha256,
            status: AppliedStatus::Refused,
            reason: Some(refusal.reason),
            applied_at_ns: now,
            values: self.memory.held.values,
        })]
    }

    /// Logs the reason for rejecting a signed message, no more often than a refusal.
    pub(super) fn disbelieve(&mut self, what: &str, reason: &str, now: RobotTime) -> Vec<Effect> {
        let said = self.disbelieved_ns;
        if said.is_some_and(|at_ns| now < at_ns.plus(SAME_REFUSAL)) {
            return Vec::new();
        }
        self.disbelieved_ns = Some(now);
        vec![Effect::Note(format!("{what} is not believed: {reason}"))]
    }

    /// Acknowledges a signed document with a final decision.
    pub(super) fn decide(
        &mut self,
        generation: Generation,
        sha256: String,
        status: AppliedStatus,
        reason: Option<String>,
        now: RobotTime,
    ) -> Vec<Effect> {
        let answer = Applied {
            generation,
            sha256,
            status,
            reason,
            applied_at_ns: now,
            values: self.memory.held.values,
        };
        let memory = &mut self.memory;
        memory.highest = memory.highest.max(generation);
        memory.latest = Some(answer.clone());
        memory
            .unstored
            .retain(|earlier| !same_document(earlier, &answer));
        memory.unstored.push(answer.clone());
        let surplus = memory.unstored.len().saturating_sub(UNSTORED_MAX);
        memory.unstored.drain(..surplus);
        self.repeat_at_ns = now.plus(self.repeat_pause());
        vec![Effect::Acknowledge(answer)]
    }

    /// Repeats all acknowledgements: the service may be new, or may have been restored from a
    /// backup.
    pub(super) fn report(&mut self, now: RobotTime) -> Vec<Effect> {
        let memory = &self.memory;
        let about_held = |answer: &Applied| memory.held.is(answer.generation, &answer.sha256);
        let mut answers: Vec<Applied> = Vec::new();
        if !memory.unstored.iter().chain(&memory.latest).any(about_held) {
            answers.extend(memory.held.acknowledgement());
        }
        answers.extend(memory.unstored.iter().cloned());
        if let Some(latest) = &memory.latest
            && !answers.contains(latest)
        {
            answers.push(latest.clone());
        }
        self.repeat_at_ns = now.plus(self.repeat_pause());
        answers.into_iter().map(Effect::Acknowledge).collect()
    }

    pub(super) fn repeat_pause(&self) -> Duration {
        match self.memory.phase {
            Phase::Resting(Rest::Unconfirmed(_)) => REPEAT_URGENT,
            _ => REPEAT,
        }
    }
}

fn same_document(a: &Applied, b: &Applied) -> bool {
    a.generation == b.generation && a.sha256 == b.sha256
}
