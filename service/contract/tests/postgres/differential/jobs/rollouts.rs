//! Roll-outs of the proposals that are open, with changes drawn at random.

use std::fmt::Write as _;

use fleetcal_domain::access::Actor;
use fleetcal_model::RolloutId;
use fleetcal_rollout::{Changed, Event, Member, Rollout, Take, WavePlan};
use fleetcal_store::StoreError;
use rand::Rng;

use super::super::chance::{pick, robots, words};
use super::{Run, ask};

impl Run<'_> {
    pub(super) async fn roll_out(&mut self) -> Result<(), StoreError> {
        let id = ask!(self, next_rollout());
        let mut members = Vec::new();
        for robot in robots() {
            let ledger = ask!(self, ledger(&robot, None));
            members.extend(ledger.open.map(|open| Member {
                robot,
                wave: self.chance.random_range(1..3),
                proposal: open.id,
                revision: open.revision,
            }));
        }
        let plan = WavePlan {
            take: Take::Q(words(&mut self.chance)),
            verified_share: 0.1 + 0.2,
            failed_share: 0.0,
        };
        let (q, reason) = (words(&mut self.chance), Some(words(&mut self.chance)));
        let waves = vec![(plan.clone(), 1), (plan, 2)];
        let rollout = Rollout::start(id, q, waves, &Actor::command_line(), reason, self.now);
        ask!(self, save_rollout(&rollout));
        ask!(self, add_rollout_robots(id, &members));
        ask!(self, rollouts_beside(id));
        ask!(self, rollout_taken(id));
        let former = RolloutId(self.chance.random_range(0..=id.0));
        let before = ask!(self, rollout(former));
        ask!(self, rollout(RolloutId(u64::MAX)));
        let robots = ask!(self, rollout_robots(former));
        let Some(before) = before else {
            return Ok(());
        };
        let events = [Event::Pause, Event::Halt, Event::BeginWave, Event::Finish];
        let event = if self.chance.random_bool(0.3) {
            Event::Resume(before.counts(&robots))
        } else {
            events[pick(&mut self.chance, &[0, 1, 2, 3])].clone()
        };
        let changed = Changed {
            by: words(&mut self.chance),
            at_ns: self.now,
            reason: None,
        };
        if let Ok(after) = before.after(&event, changed) {
            ask!(self, save_rollout(&after));
        }
        Ok(())
    }
}
