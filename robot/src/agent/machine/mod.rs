//! The agent's decisions, without clock, wire or disk: events in, effects out.
//!
//! Whoever performs the effects writes the memory down before the first of them, so that a kill at
//! any moment resumes where it was.

mod answers;
mod applying;
mod key_changes;

use std::time::Duration;

use fleetcal_model::RobotTime;
use fleetcal_proto::calibration::{AppliedStatus, Confirmed};
use fleetcal_proto::offer::{Offered, Question};
use fleetcal_proto::signing::TrustedKeys;

use super::event::{Effect, Event, TransitionRefused};
use super::keys::with_remedy;
use super::offer::{Identity, Refusal, Verdict, judge};
use super::state::{Memory, Phase, Rest, Trial};

/// Time for which a robot that was off while its deadline passed waits for the service, once.
const RESTART_GRACE: Duration = Duration::from_secs(30);
/// Least interval between queries for pushed documents.
const ASK_PAUSE: Duration = Duration::from_secs(1);

/// State machine of a robot's side of the life cycle.
#[derive(Debug, Clone)]
pub struct Agent {
    /// Its identity, with the keys that it trusts now.
    identity: Identity,
    /// Keys that it was given.
    given: TrustedKeys,
    memory: Memory,
    /// True if a document came while another one was being handled.
    pull_after: bool,
    /// Time of the next query: the robot was busy, or more was pushed just after a query.
    pull_at_ns: Option<RobotTime>,
    /// Time from which a pushed document is a reason to query again.
    hint_from_ns: RobotTime,
    restore_again_ns: Option<RobotTime>,
    repeat_at_ns: RobotTime,
    last_refusal: Option<(Refusal, RobotTime)>,
    /// Time of the last logged rejection of a confirmation or of a change of key.
    disbelieved_ns: Option<RobotTime>,
}

impl Agent {
    /// Makes an agent that continues from `memory`. Its first event is [`Event::Restarted`].
    pub fn new(identity: Identity, memory: Memory) -> Self {
        let mut agent = Self {
            given: identity.trusted.clone(),
            identity,
            memory,
            pull_after: false,
            pull_at_ns: None,
            hint_from_ns: RobotTime(i64::MIN),
            restore_again_ns: None,
            repeat_at_ns: RobotTime::default(),
            last_refusal: None,
            disbelieved_ns: None,
        };
        agent.begin_with_keys();
        agent
    }

    /// Returns its memory, to be stored before the effects of a step are performed.
    pub fn memory(&self) -> &Memory {
        &self.memory
    }

    /// Handles one event.
    ///
    /// # Errors
    /// The event cannot happen in this phase; nothing has changed then.
    pub fn step(&mut self, event: Event, now: RobotTime) -> Result<Vec<Effect>, TransitionRefused> {
        let refused = TransitionRefused::new(&event, &self.memory.phase);
        self.expire_keys(&event, now);
        match (event, self.memory.phase.clone()) {
            (Event::Restarted { written }, phase) => Ok(self.resume(phase, written, now)),
            (Event::Offered { offered, answers }, Phase::Resting(rest)) => {
                Ok(self.consider(&offered, answers.as_ref(), rest, now))
            }
            (Event::Offered { .. }, _) => {
                self.pull_after = true;
                Ok(Vec::new())
            }
            (Event::Confirmed(confirmed), _) => Ok(self.confirmed(&confirmed, now)),
            (Event::KeyChanged(changes), _) => Ok(self.key_changed(&changes, now)),
            (Event::ServiceUp, _) => Ok(self.report(now)),
            (Event::Tick, phase) => Ok(self.tick(phase, now)),
            (Event::HookAnswered(answer), Phase::Asking { offer, rest }) => {
                Ok(self.hook_answered(answer, offer, rest, now))
            }
            (
                Event::Written(result),
                Phase::Writing {
                    offer,
                    rest,
                    before,
                },
            ) => Ok(self.written(result, offer, rest, before)),
            (
                Event::Activated(activation),
                Phase::Activating {
                    offer,
                    rest,
                    before,
                },
            ) => Ok(self.activated(activation, offer, rest, before, now)),
            (Event::Restored(result), Phase::Restoring { ending, .. }) => {
                Ok(self.restored(result, ending, now))
            }
            (
                Event::RevertTold(result),
                Phase::Restoring {
                    fallback,
                    rest,
                    ending,
                },
            ) => Ok(self.reverted(result, fallback.held, rest, ending, now)),
            (
                Event::HookAnswered(_)
                | Event::Written(_)
                | Event::Activated(_)
                | Event::Restored(_)
                | Event::RevertTold(_),
                _,
            ) => Err(refused),
        }
    }

    fn resume(&mut self, phase: Phase, written: bool, now: RobotTime) -> Vec<Effect> {
        let mut effects = match phase {
            // The file is right: only the hook has to be told, once more perhaps.
            Phase::Writing {
                offer,
                rest,
                before,
            }
            | Phase::Activating {
                offer,
                rest,
                before,
            } if written => self.activate(offer, rest, before),
            Phase::Restoring { fallback, .. } => vec![Effect::Restore(fallback)],
            // What was asked or about to be written comes again with the next pull.
            Phase::Resting(rest)
            | Phase::Asking { rest, .. }
            | Phase::Writing { rest, .. }
            | Phase::Activating { rest, .. } => self.rest(rest),
        };
        if let Rest::Unconfirmed(trial) = self.memory.phase.rest_mut() {
            put_off(trial, now);
        }
        effects.extend(self.report(now));
        effects
    }

    fn rest(&mut self, rest: Rest) -> Vec<Effect> {
        self.memory.phase = Phase::Resting(rest);
        if std::mem::take(&mut self.pull_after) {
            return vec![Effect::Pull];
        }
        Vec::new()
    }

    fn consider(
        &mut self,
        offered: &Offered,
        answers: Option<&Question>,
        rest: Rest,
        now: RobotTime,
    ) -> Vec<Effect> {
        match judge(&self.identity, &self.memory, offered, answers, now) {
            Verdict::Fit(offer) => {
                self.pull_at_ns = None;
                let ask = Effect::AskHook(offer.clone());
                self.memory.phase = Phase::Asking { offer, rest };
                vec![ask]
            }
            Verdict::Known => self.remind(&offered.envelope, now),
            Verdict::Unasked => self.ask_soon(now),
            Verdict::Unfit(refusal) => {
                let Refusal {
                    generation,
                    sha256,
                    reason,
                } = refusal;
                self.decide(
                    generation,
                    sha256,
                    AppliedStatus::Refused,
                    Some(reason),
                    now,
                )
            }
            Verdict::Stale(refusal) | Verdict::Forged(refusal) => self.refuse(refusal, now),
            Verdict::Mistaken(reason) => vec![Effect::Note(format!(
                "an altered copy of a document that was decided upon is ignored: {reason}"
            ))],
        }
    }

    /// Queries the pushed document; many pushes lead to one query a second.
    fn ask_soon(&mut self, now: RobotTime) -> Vec<Effect> {
        if now < self.hint_from_ns {
            let soon = self.hint_from_ns;
            self.pull_at_ns = Some(self.pull_at_ns.map_or(soon, |at_ns| at_ns.min(soon)));
            return Vec::new();
        }
        self.hint_from_ns = now.plus(ASK_PAUSE);
        vec![Effect::Pull]
    }

    /// Handles a confirmation, trusting only signed content: an acknowledgement is stored, and if
    /// it reported the held values as in use, they stay.
    fn confirmed(&mut self, confirmed: &Confirmed, now: RobotTime) -> Vec<Effect> {
        let stored = match confirmed.open(&self.identity.trusted) {
            Ok(stored) if stored.robot == self.identity.robot => stored,
            Ok(stored) => {
                let reason = format!("it is about {}", stored.robot);
                return self.disbelieve("a confirmation", &reason, now);
            }
            Err(error) => return self.disbelieve("a confirmation", &with_remedy(&error), now),
        };
        self.memory
            .unstored
            .retain(|answer| !stored.confirms(answer));
        let in_use = self.memory.held.acknowledgement();
        if in_use.is_some_and(|in_use| stored.confirms(&in_use)) {
            *self.memory.phase.rest_mut() = Rest::Settled;
        }
        Vec::new()
    }

    fn tick(&mut self, phase: Phase, now: RobotTime) -> Vec<Effect> {
        let mut effects = Vec::new();
        match phase {
            Phase::Resting(Rest::Unconfirmed(trial)) if now >= trial.until_ns => {
                return self.give_up(trial);
            }
            Phase::Restoring { fallback, .. } if passed(self.restore_again_ns, now) => {
                self.restore_again_ns = None;
                effects.push(Effect::Restore(fallback));
            }
            _ => {}
        }
        if passed(self.pull_at_ns, now) {
            self.pull_at_ns = None;
            effects.push(Effect::Pull);
        }
        if !self.memory.unstored.is_empty() && now >= self.repeat_at_ns {
            self.repeat_at_ns = now.plus(self.repeat_pause());
            let answers = self.memory.unstored.iter().cloned();
            effects.extend(answers.map(Effect::Acknowledge));
            effects.push(Effect::AskConfirmed);
        }
        effects
    }
}

/// Adjusts the deadline after a restart. It stands, but a clock that was set back does not extend
/// it, and a robot that was off when it passed first waits for the service, once.
fn put_off(trial: &mut Trial, now: RobotTime) {
    let latest = now.plus(seconds(trial.confirm_within_s));
    trial.until_ns = trial.until_ns.min(latest);
    let grace = now.plus(RESTART_GRACE);
    if trial.until_ns < grace && !trial.put_off {
        trial.until_ns = grace;
        trial.put_off = true;
    }
}

fn passed(at_ns: Option<RobotTime>, now: RobotTime) -> bool {
    at_ns.is_some_and(|at_ns| now >= at_ns)
}

fn seconds(count: u32) -> Duration {
    Duration::from_secs(count.into())
}
