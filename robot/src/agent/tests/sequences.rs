//! Any sequence of events, with kills between any two effects.

use std::collections::{BTreeMap, VecDeque};

use fleetcal_model::{Generation, RobotTime};
use fleetcal_proto::calibration::{Applied, AppliedStatus};
use proptest::prelude::*;

use super::*;
use crate::agent::{Activation, Agent, Effect, Event, HookAnswer, Phase, Rest};

/// An outside event, with the outcomes of the next calls to the surroundings.
#[derive(Debug, Clone)]
enum Step {
    Offer {
        generation: Generation,
        base: u64,
        confirm_within_s: u32,
        good: bool,
    },
    Confirm {
        generation: Generation,
    },
    ServiceUp,
    Pass {
        seconds: i64,
    },
    Answers {
        hook: u8,
        activation: u8,
        writes: bool,
        restores: bool,
    },
    /// The process ends after this number of events and effects from now on, and starts again.
    Kill {
        moments: u8,
    },
}

fn step() -> impl Strategy<Value = Step> {
    let generation = 0_u64..12;
    prop_oneof![
        6 => (generation.clone(), 0_u64..12, prop_oneof![Just(5_u32), Just(600), Just(0)], prop::bool::weighted(0.8))
            .prop_map(|(generation, base, confirm_within_s, good)| Step::Offer { generation: Generation(generation), base, confirm_within_s, good }),
        3 => generation.prop_map(|generation| Step::Confirm { generation: Generation(generation) }),
        1 => Just(Step::ServiceUp),
        4 => prop_oneof![Just(1_i64), Just(20), Just(700)].prop_map(|seconds| Step::Pass { seconds }),
        2 => (0_u8..4, 0_u8..4, any::<bool>(), any::<bool>())
            .prop_map(|(hook, activation, writes, restores)| Step::Answers { hook, activation, writes, restores }),
        2 => (0_u8..8).prop_map(|moments| Step::Kill { moments }),
    ]
}

/// A robot with a disk: file and memory survive a kill.
struct Robot {
    agent: Agent,
    now: RobotTime,
    /// Generation whose values the file holds; 0 for its former content.
    file: u64,
    remembered: Memory,
    /// Calls in flight, which are lost with the process.
    open: VecDeque<Event>,
    hook: u8,
    activation: u8,
    writes: bool,
    restores: bool,
    moments_left: Option<u8>,
    /// Number of times that each generation came into use.
    came_into_use: BTreeMap<u64, u32>,
    answers: Vec<Applied>,
}

impl Robot {
    fn new() -> Self {
        let mut robot = Self {
            agent: Agent::new(identity(), first_memory()),
            now: RobotTime(START_NS),
            file: 0,
            remembered: first_memory(),
            open: VecDeque::new(),
            hook: 0,
            activation: 0,
            writes: true,
            restores: true,
            moments_left: None,
            came_into_use: BTreeMap::new(),
            answers: Vec::new(),
        };
        robot.take(Event::Restarted { written: false });
        robot
    }

    fn take(&mut self, event: Event) {
        self.open.push_back(event);
        while let Some(event) = self.open.pop_front() {
            if self.dies() {
                self.restart();
                return;
            }
            let before = self.agent.memory().held.generation;
            let falls_back = matches!(event, Event::RevertTold(_));
            let effects = self.agent.step(event, self.now).unwrap();
            let memory = self.agent.memory();
            assert!(
                memory.held.generation >= before || falls_back,
                "what is held fell"
            );
            if memory.held.generation > before {
                *self
                    .came_into_use
                    .entry(memory.held.generation.0)
                    .or_default() += 1;
                assert_eq!(
                    self.file, memory.held.generation.0,
                    "held, but not in the file"
                );
            }
            assert!(memory.unstored.len() <= 4);
            self.remembered = memory.clone();
            for effect in effects {
                if self.dies() {
                    self.restart();
                    return;
                }
                self.perform(effect);
            }
        }
    }

    fn dies(&mut self) -> bool {
        match &mut self.moments_left {
            Some(0) => true,
            Some(left) => {
                *left -= 1;
                false
            }
            None => false,
        }
    }

    fn restart(&mut self) {
        self.moments_left = None;
        self.open.clear();
        let memory = self.remembered.clone();
        let written = match &memory.phase {
            Phase::Writing { offer, .. } | Phase::Activating { offer, .. } => {
                offer.generation == Generation(self.file)
            }
            _ => false,
        };
        self.agent = Agent::new(identity(), memory);
        self.take(Event::Restarted { written });
    }

    fn perform(&mut self, effect: Effect) {
        match effect {
            Effect::AskHook(_) => self.open.push_back(Event::HookAnswered(match self.hook {
                0 | 1 => HookAnswer::Go {
                    before: Some(self.file.to_string()),
                },
                2 => HookAnswer::Busy,
                _ => HookAnswer::Failed("no".to_owned()),
            })),
            Effect::Write(values) => {
                let written = self.writes.then_some(()).ok_or("full".to_owned());
                if self.writes {
                    self.file = (values.steering_offset_rad * 1e3).round() as u64;
                }
                self.open.push_back(Event::Written(written));
            }
            Effect::Restore(fallback) => {
                let restored = self.restores.then_some(()).ok_or("full".to_owned());
                if self.restores {
                    self.file = fallback.file.unwrap().parse().unwrap();
                    assert_eq!(self.file, fallback.held.generation.0);
                }
                self.open.push_back(Event::Restored(restored));
            }
            Effect::Activate(offer) => {
                assert_eq!(self.file, offer.generation.0, "told, but not in the file");
                self.open.push_back(Event::Activated(match self.activation {
                    0 | 1 => Activation::Done,
                    2 => Activation::Busy,
                    _ => Activation::Failed("no".to_owned()),
                }));
            }
            Effect::TellReverted(_) => {
                let told = (self.activation < 2).then_some(()).ok_or("no".to_owned());
                self.open.push_back(Event::RevertTold(told));
            }
            Effect::Acknowledge(answer) => self.answers.push(answer),
            _ => {}
        }
    }

    #[expect(clippy::needless_pass_by_value, reason = "a step is used up")]
    fn go(&mut self, step: Step) {
        match step {
            Step::Offer {
                generation,
                base,
                confirm_within_s,
                good,
            } => {
                let mut document = document(generation.0);
                document.base_generation = Some(Generation(base));
                document.confirm_within_s = confirm_within_s;
                let key = if good { key() } else { strange_key() };
                self.take(answered(&seal(&document, &key).unwrap()));
            }
            Step::Confirm { generation } => {
                // What the service stored is what this robot answered, last or before.
                let mut answers = self.answers.iter().rev();
                let answer = answers.find(|answer| answer.generation == generation);
                let Some(answer) = answer.cloned() else {
                    return;
                };
                let before = self.agent.memory().clone();
                self.take(Event::Confirmed(confirmation_of(&answer)));
                let mut after = self.agent.memory().clone();
                let was_on_trial = *before.phase.clone().rest_mut() != Rest::Settled;
                let is_settled = *after.phase.rest_mut() == Rest::Settled;
                if was_on_trial && is_settled && after.held == before.held {
                    let held = before.held.acknowledgement();
                    assert_eq!(
                        Some(answer.applied_at_ns),
                        held.map(|one| one.applied_at_ns)
                    );
                    assert_eq!(answer.status, AppliedStatus::Applied);
                }
            }
            Step::ServiceUp => self.take(Event::ServiceUp),
            Step::Pass { seconds } => {
                self.now.0 += seconds * SECOND_NS;
                self.take(Event::Tick);
            }
            Step::Answers {
                hook,
                activation,
                writes,
                restores,
            } => {
                (self.hook, self.activation) = (hook, activation);
                (self.writes, self.restores) = (writes, restores);
            }
            Step::Kill { moments } => self.moments_left = Some(moments),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    #[test]
    fn what_is_held_falls_only_back_and_nothing_comes_into_use_twice(
        steps in prop::collection::vec(step(), 0..60),
    ) {
        let mut robot = Robot::new();
        for step in steps {
            robot.go(step);
        }
        for (generation, times) in &robot.came_into_use {
            prop_assert_eq!(*times, 1, "generation {} came into use {} times", generation, times);
        }
        // What came into use was answered, if only after a restart and when the disk allows.
        robot.moments_left = None;
        (robot.writes, robot.restores) = (true, true);
        robot.restart();
        for _ in 0..3 {
            robot.go(Step::Pass { seconds: 60 });
        }
        let Memory { held, phase, .. } = robot.agent.memory();
        prop_assert_eq!(robot.file, held.generation.0);
        let is_resting = matches!(phase, Phase::Resting(_));
        prop_assert!(is_resting, "it is {}", phase.name());
        for generation in robot.came_into_use.keys() {
            let about_it = |answer: &&Applied| answer.generation == Generation(*generation)
                && matches!(answer.status, AppliedStatus::Applied | AppliedStatus::Reverted);
            prop_assert!(robot.answers.iter().any(|answer| about_it(&answer)), "{} was never answered", generation);
        }
    }
}
