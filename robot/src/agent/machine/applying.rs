//! Application of a document that passed every check, and the way back.

use std::time::Duration;

use fleetcal_model::RobotTime;
use fleetcal_proto::calibration::AppliedStatus;

use super::{Agent, seconds};
use crate::agent::event::{Activation, Effect, HookAnswer};
use crate::agent::state::{Ending, Fallback, Held, Offer, Outcome, Phase, Rest, Trial};

/// Delay before a busy robot is queried again.
const BUSY_RETRY: Duration = Duration::from_secs(15);
/// Delay before a failed restoration is tried again.
const RESTORE_RETRY: Duration = Duration::from_secs(5);

impl Agent {
    pub(super) fn hook_answered(
        &mut self,
        answer: HookAnswer,
        offer: Offer,
        rest: Rest,
        now: RobotTime,
    ) -> Vec<Effect> {
        match answer {
            HookAnswer::Go { .. } if now >= offer.ends_ns => {
                let generation = offer.generation;
                let mut effects = vec![Effect::Note(format!(
                    "the offer of generation {generation} has ended while the hook was asked: the \
                     service is asked again"
                ))];
                effects.extend(self.rest(rest));
                effects.push(Effect::Pull);
                effects
            }
            HookAnswer::Go { before } => {
                let write = Effect::Write(offer.values);
                self.memory.phase = Phase::Writing {
                    offer,
                    rest,
                    before,
                };
                vec![write]
            }
            HookAnswer::Busy => {
                self.pull_at_ns = Some(now.plus(BUSY_RETRY));
                self.rest(rest)
            }
            HookAnswer::Failed(reason) => {
                let (generation, sha256) = (offer.generation, offer.sha256);
                let failed = AppliedStatus::Failed;
                let mut effects = self.decide(generation, sha256, failed, Some(reason), now);
                effects.extend(self.rest(rest));
                effects
            }
        }
    }

    pub(super) fn written(
        &mut self,
        result: Result<(), String>,
        offer: Offer,
        rest: Rest,
        before: Option<String>,
    ) -> Vec<Effect> {
        match result {
            Ok(()) => self.activate(offer, rest, before),
            Err(reason) => self.take_back(offer, rest, before, failed(reason)),
        }
    }

    pub(super) fn activate(
        &mut self,
        offer: Offer,
        rest: Rest,
        before: Option<String>,
    ) -> Vec<Effect> {
        let activate = Effect::Activate(offer.clone());
        self.memory.phase = Phase::Activating {
            offer,
            rest,
            before,
        };
        vec![activate]
    }

    pub(super) fn activated(
        &mut self,
        activation: Activation,
        offer: Offer,
        rest: Rest,
        before: Option<String>,
        now: RobotTime,
    ) -> Vec<Effect> {
        match activation {
            Activation::Done => self.in_use(offer, rest, before, now),
            Activation::Busy => self.take_back(offer, rest, before, Outcome::Later),
            Activation::Failed(reason) => self.take_back(offer, rest, before, failed(reason)),
        }
    }

    fn in_use(
        &mut self,
        offer: Offer,
        rest: Rest,
        before: Option<String>,
        now: RobotTime,
    ) -> Vec<Effect> {
        let fallback = self.fallback(rest, before);
        self.memory.held = Held {
            generation: offer.generation,
            sha256: offer.sha256.clone(),
            applied_at_ns: now,
            values: Some(offer.values),
            rear_axle_in_base_link: offer.rear_axle_in_base_link,
            steering_table: offer.steering_table,
        };
        let trial = Trial {
            until_ns: now.plus(seconds(offer.confirm_within_s)),
            confirm_within_s: offer.confirm_within_s,
            put_off: false,
            document: offer.document,
            fallback,
        };
        let mut effects = self.rest(Rest::Unconfirmed(trial));
        let (generation, sha256) = (offer.generation, offer.sha256);
        effects.extend(self.decide(generation, sha256, AppliedStatus::Applied, None, now));
        effects
    }

    /// Reverts values that came into use and were not confirmed.
    pub(super) fn give_up(&mut self, trial: Trial) -> Vec<Effect> {
        let Held {
            generation, sha256, ..
        } = self.memory.held.clone();
        let ending = Ending {
            generation,
            sha256,
            outcome: Outcome::Answered {
                status: AppliedStatus::Reverted,
                reason: format!("no confirmation within {} s", trial.confirm_within_s),
            },
            document: trial.document,
        };
        self.go_back(trial.fallback, Rest::Settled, ending)
    }

    /// Reverts values that never came into use: the former ones are as settled as before.
    fn take_back(
        &mut self,
        offer: Offer,
        rest: Rest,
        before: Option<String>,
        outcome: Outcome,
    ) -> Vec<Effect> {
        let fallback = Fallback {
            held: self.memory.held.clone(),
            file: before,
        };
        let ending = Ending {
            generation: offer.generation,
            sha256: offer.sha256,
            outcome,
            document: offer.document,
        };
        self.go_back(fallback, rest, ending)
    }

    fn go_back(&mut self, fallback: Fallback, rest: Rest, ending: Ending) -> Vec<Effect> {
        if let Outcome::Answered { .. } = ending.outcome {
            self.memory.highest = self.memory.highest.max(ending.generation);
        }
        let restore = Effect::Restore(fallback.clone());
        self.memory.phase = Phase::Restoring {
            fallback,
            rest,
            ending,
        };
        vec![restore]
    }

    /// Returns the state that was confirmed last.
    fn fallback(&self, rest: Rest, before: Option<String>) -> Fallback {
        match rest {
            Rest::Settled => Fallback {
                held: self.memory.held.clone(),
                file: before,
            },
            Rest::Unconfirmed(trial) => trial.fallback,
        }
    }

    pub(super) fn restored(
        &mut self,
        result: Result<(), String>,
        ending: Ending,
        now: RobotTime,
    ) -> Vec<Effect> {
        if let Err(reason) = result {
            self.restore_again_ns = Some(now.plus(RESTORE_RETRY));
            return vec![Effect::Note(format!(
                "the former values cannot be written back, it will be tried again: {reason}"
            ))];
        }
        vec![Effect::TellReverted(ending)]
    }

    /// Completes a reversion: the former values are in use again, whatever the hook returns.
    pub(super) fn reverted(
        &mut self,
        told: Result<(), String>,
        held: Held,
        rest: Rest,
        ending: Ending,
        now: RobotTime,
    ) -> Vec<Effect> {
        self.memory.held = held;
        let mut effects = self.rest(rest);
        match ending.outcome {
            Outcome::Answered { status, reason } => {
                let reason = match told {
                    Ok(()) => reason,
                    Err(fault) => format!("{reason}; the file says the former values, but {fault}"),
                };
                let (generation, sha256) = (ending.generation, ending.sha256);
                effects.extend(self.decide(generation, sha256, status, Some(reason), now));
            }
            Outcome::Later => {
                self.pull_at_ns = Some(now.plus(BUSY_RETRY));
                effects.extend(told.err().map(Effect::Note));
            }
        }
        effects
    }
}

fn failed(reason: String) -> Outcome {
    Outcome::Answered {
        status: AppliedStatus::Failed,
        reason,
    }
}
