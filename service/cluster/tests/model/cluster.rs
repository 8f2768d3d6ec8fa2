//! Steps of the model, and the properties that always hold.

use stateright::{Model, Property};

use crate::world::{EPOCHS, Instance, Planted, Process, STEP_S, World};

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Action {
    Time,
    Join(usize),
    Renew(usize),
    TakeForDead {
        by: usize,
        whom: usize,
    },
    Claim(usize),
    /// Brings an own robot's epoch to the database's timeline.
    Restamp(usize),
    /// Names the next owner of an own robot.
    NameHeir {
        by: usize,
        whom: usize,
    },
    /// Confirms that it receives the robot whose heir it is.
    NoteReady(usize),
    /// Ends its tenure because the heir receives the robot.
    EndTenure(usize),
    HandOver(usize),
    /// Starts to estimate a robot that is its own by the rows, and drops one that is not.
    Follow(usize),
    BeginWrite(usize),
    EndWrite(usize),
    PassGate(usize),
    Put(usize),
    Freeze(usize),
    Thaw(usize),
    CutOff(usize),
    Heal(usize),
    Kill(usize),
    Restart(usize),
    Replicate,
    FailOver,
}

/// Model to explore: a number of instances of which one has the robot, and the largest number of
/// hand-overs.
#[derive(Debug, Clone, Copy)]
pub struct Cluster {
    pub planted: Planted,
    pub instances: usize,
    pub moves: u8,
    /// Largest number of failovers of the database.
    pub failovers: u8,
    /// Largest number of processes that are frozen.
    pub freezes: u8,
    /// Largest number of instances that are cut off from the database.
    pub cuts: u8,
    /// Largest number of processes that are killed.
    pub kills: u8,
    pub seconds_max: u64,
}

impl Cluster {
    /// Adds the actions by which an instance that reaches the database can hand the robot over, or
    /// start to estimate it.
    fn moves_of(&self, world: &World, i: usize, actions: &mut Vec<Action>) {
        if self.moves == 0 {
            return;
        }
        let instance = &world.instances[i];
        let others = (0..self.instances).filter(|whom| *whom != i && world.live(*whom).is_some());
        if world.moves_left > 0 && world.owns(i) && world.database.row.heir.is_none() {
            actions.extend(others.map(|whom| Action::NameHeir { by: i, whom }));
        }
        if world.is_heir(i) == Some(false) {
            actions.push(Action::NoteReady(i));
        }
        if instance.handing_over {
            actions.push(Action::HandOver(i));
        } else if world.has_ready_heir(i)
            && instance.tenure.is_some()
            && instance.writing.is_none()
            && instance.putting.is_none()
        {
            // Its estimator has ended and all is written by then.
            actions.push(Action::EndTenure(i));
        }
        let own = world.owns(i).then_some(world.database.row.epoch);
        if instance.incarnation.is_some() && instance.tenure != own {
            actions.push(Action::Follow(i));
        }
    }
}

impl Model for Cluster {
    type State = World;
    type Action = Action;

    fn init_states(&self) -> Vec<World> {
        let mut world = World {
            failovers_left: self.failovers,
            freezes_left: self.freezes,
            cuts_left: self.cuts,
            moves_left: self.moves,
            kills_left: self.kills,
            timeline: 1,
            instances: vec![Instance::default(); self.instances],
            ..World::default()
        };
        world.database.incarnations = vec![0; self.instances];
        world.database.expires_at_s = vec![0; self.instances];
        for i in 0..self.instances {
            world.join(i);
        }
        world.claim(0, self.planted);
        world.standby = world.database.clone();
        vec![world]
    }

    fn actions(&self, world: &World, actions: &mut Vec<Action>) {
        if world.now_s < self.seconds_max {
            actions.push(Action::Time);
        }
        if world.failovers_left > 0 {
            actions.push(Action::FailOver);
            if world.standby != world.database {
                actions.push(Action::Replicate);
            }
        }
        for i in 0..self.instances {
            let instance = &world.instances[i];
            if instance.process == Process::Killed {
                actions.push(Action::Restart(i));
                if instance.writing.is_some() {
                    actions.push(Action::EndWrite(i));
                }
                continue;
            }
            if world.kills_left > 0 {
                actions.push(Action::Kill(i));
            }
            if instance.process == Process::Frozen {
                actions.push(Action::Thaw(i));
                continue;
            }
            if world.freezes_left > 0 {
                actions.push(Action::Freeze(i));
            }
            if instance.cut_off {
                actions.push(Action::Heal(i));
            } else if world.cuts_left > 0 {
                actions.push(Action::CutOff(i));
            }
            let trusts = world.now_s < instance.trusted_until_s;
            if instance.putting.is_some() {
                actions.push(Action::Put(i));
            } else if instance.tenure.is_some() && (trusts || self.planted == Planted::NoGate) {
                actions.push(Action::PassGate(i));
            }
            if !world.reaches(i) {
                continue;
            }
            match instance.incarnation {
                None => actions.push(Action::Join(i)),
                Some(_) => actions.push(Action::Renew(i)),
            }
            if instance.writing.is_some() {
                actions.push(Action::EndWrite(i));
            } else if instance.tenure.is_some() {
                actions.push(Action::BeginWrite(i));
            }
            if world.has_seat(i) && world.database.row.owner.is_none() {
                actions.push(Action::Claim(i));
            }
            if world.owns(i) && world.database.row.epoch < world.timeline * EPOCHS {
                actions.push(Action::Restamp(i));
            }
            for whom in 0..self.instances {
                if world.may_take_for_dead(i, whom) {
                    actions.push(Action::TakeForDead { by: i, whom });
                }
            }
            self.moves_of(world, i, actions);
        }
    }

    fn next_state(&self, last: &World, action: Action) -> Option<World> {
        let mut world = last.clone();
        match action {
            Action::Time => world.now_s += STEP_S,
            Action::Join(i) => world.join(i),
            Action::Renew(i) => world.renew(i),
            Action::TakeForDead { whom, .. } => {
                world.database.incarnations[whom] += 1;
                world.free(whom);
            }
            Action::Claim(i) | Action::Restamp(i) => world.claim(i, self.planted),
            Action::NameHeir { whom, .. } => {
                world.moves_left -= 1;
                world.database.row.heir = world.live(whom).map(|heir| (heir, false));
            }
            Action::NoteReady(_) => {
                world.database.row.heir = world.database.row.heir.map(|(heir, _)| (heir, true));
            }
            Action::EndTenure(i) => {
                let instance = &mut world.instances[i];
                instance.handing_over = true;
                if self.planted != Planted::HandedOverWithItsEpoch {
                    instance.tenure = None;
                }
            }
            Action::HandOver(i) => world.hand_over(i, self.planted),
            Action::Follow(i) => world.follow(i),
            Action::BeginWrite(i) => {
                let instance = &mut world.instances[i];
                instance.writing = instance.incarnation.zip(instance.tenure);
            }
            Action::EndWrite(i) => {
                let write = world.instances[i].writing.take()?;
                if self.planted == Planted::NoFence || world.accepts(i, write) {
                    world.accept(i, write.1);
                }
            }
            Action::PassGate(i) => world.instances[i].putting = world.instances[i].tenure,
            Action::Put(i) => {
                let epoch = world.instances[i].putting.take()?;
                world.late_puts += u8::from(epoch < world.put && !world.owns(i));
                world.put = world.put.max(epoch);
                if !world.putters.contains(&(epoch, i)) {
                    world.putters.push((epoch, i));
                }
            }
            Action::Freeze(i) => {
                world.freezes_left -= 1;
                world.instances[i].process = Process::Frozen;
            }
            Action::Thaw(i) | Action::Restart(i) => world.instances[i].process = Process::Running,
            Action::CutOff(i) => {
                world.cuts_left -= 1;
                world.instances[i].cut_off = true;
            }
            Action::Heal(i) => world.instances[i].cut_off = false,
            Action::Kill(i) => world.kill(i),
            Action::Replicate => world.standby = world.database.clone(),
            Action::FailOver => world.fail_over(),
        }
        (world != *last).then_some(world)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        vec![
            Property::always(
                "no write after one of a later tenure",
                |_, world: &World| world.late_writes == 0,
            ),
            Property::always("one instance an epoch", |_, world: &World| {
                is_one_an_epoch(&world.putters) && is_one_an_epoch(&world.database.writers)
            }),
            Property::always("one late put at the most", |_, world: &World| {
                world.late_puts <= 1
            }),
            Property::always("an owner in the end", |model: &Self, world: &World| {
                world.recovers(model.planted)
            }),
            Property::sometimes("the robot changes hands", |_, world: &World| {
                world.database.writers.iter().any(|(_, by)| *by != 0)
            }),
        ]
    }
}

fn is_one_an_epoch(seen: &[(u64, usize)]) -> bool {
    let other = |(epoch, by): &(u64, usize)| seen.iter().any(|(of, i)| of == epoch && i != by);
    !seen.iter().any(other)
}
