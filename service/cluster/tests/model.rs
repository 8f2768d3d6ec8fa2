//! A model of lease, epoch and fence, explored state by state: instances are frozen, cut off from
//! the database and killed at any step, a robot is handed over meanwhile, and the database forgets its latest
//! commits in a failover.
//!
//! One step of time is two seconds. What the database does in one transaction is one action here, as
//! `service/postgres` has it; what an instance does in two is two, so that it can be frozen between.
#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test that cannot go on fails, and says what it has counted"
)]

use std::time::Duration;

use fleetcal_cluster::Lease;
use fleetcal_domain::limits::CLUSTER_LEASE;
use stateright::{Checker as _, HasDiscoveries, Model, Property};

const STEP_S: u64 = 2;
/// Bits of an epoch below the database's timeline.
const EPOCHS: u64 = 16;

type Incarnation = u8;

/// A life of an instance.
type Seat = (usize, Incarnation);

/// A robot's row.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Default)]
struct Row {
    owner: Option<Seat>,
    epoch: u64,
    /// Who is to have the robot next, by the owner's word, and whether it hears the robot.
    heir: Option<(Seat, bool)>,
}

/// What the database holds.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Default)]
struct Database {
    incarnations: Vec<Incarnation>,
    expires_at_s: Vec<u64>,
    row: Row,
    /// The epoch of the latest accepted write.
    written: u64,
    /// Who was accepted in which epoch.
    writers: Vec<(u64, usize)>,
}

/// An instance's memory.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Default)]
struct Instance {
    incarnation: Option<Incarnation>,
    trusted_until_s: u64,
    /// The epoch in which it has the robot.
    tenure: Option<u64>,
    /// A write on its way to the database, by its tenure.
    writing: Option<(Incarnation, u64)>,
    /// A put that has passed the gate and is not made yet, by its tenure.
    putting: Option<u64>,
    /// Whether it has ended its tenure in order to hand the robot over.
    handing_over: bool,
    frozen: bool,
    cut_off: bool,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, Default)]
struct World {
    now_s: u64,
    timeline: u64,
    database: Database,
    /// What a standby has, and how many failovers may still come.
    standby: Database,
    failovers_left: u8,
    freezes_left: u8,
    cuts_left: u8,
    /// How many heirs may still be named.
    moves_left: u8,
    instances: Vec<Instance>,
    /// The epoch of the latest put.
    put: u64,
    /// Writes that were accepted after one of a later tenure.
    late_writes: u8,
    /// Puts after one of a later tenure by an instance that does not have the robot any more.
    late_puts: u8,
    /// Who has put in which epoch.
    putters: Vec<(u64, usize)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Action {
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
    /// Says who is to have an own robot next.
    NameHeir {
        by: usize,
        whom: usize,
    },
    /// Says that it hears the robot that it is to have next.
    NoteReady(usize),
    /// Ends its tenure because the heir hears the robot.
    EndTenure(usize),
    HandOver(usize),
    /// Takes on a robot that is its own by the rows, and drops one that is not.
    Follow(usize),
    BeginWrite(usize),
    EndWrite(usize),
    PassGate(usize),
    Put(usize),
    Freeze(usize),
    Thaw(usize),
    CutOff(usize),
    Heal(usize),
    Replicate,
    FailOver,
}

/// What is left out of the mechanism, to see that it is needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Planted {
    Nothing,
    /// A write is accepted whatever its tenure.
    NoFence,
    /// A put asks nobody.
    NoGate,
    /// An epoch is the last one and one more, whatever a failover forgot.
    EpochWithoutTimeline,
    /// Who hands a robot over goes on with it, and leaves its epoch to the heir.
    HandedOverWithItsEpoch,
}

/// What is explored: so many instances of which one has the robot, and so many hand-overs at most.
#[derive(Debug, Clone, Copy)]
struct Cluster {
    planted: Planted,
    instances: usize,
    moves: u8,
    seconds_max: u64,
}

impl World {
    fn lease_s() -> u64 {
        CLUSTER_LEASE.as_secs()
    }

    /// Whether an instance gets an answer of the database.
    fn reaches(&self, i: usize) -> bool {
        !self.instances[i].frozen && !self.instances[i].cut_off
    }

    fn has_seat(&self, i: usize) -> bool {
        self.instances[i].incarnation == Some(self.database.incarnations[i])
    }

    fn join(&mut self, i: usize) {
        self.database.incarnations[i] += 1;
        self.free(i);
        self.database.expires_at_s[i] = self.now_s + Self::lease_s();
        let incarnation = self.database.incarnations[i];
        let trusted = Lease::trusted_after(Duration::from_secs(self.now_s));
        let instance = &mut self.instances[i];
        instance.incarnation = Some(incarnation);
        (instance.tenure, instance.handing_over) = (None, false);
        instance.trusted_until_s = trusted.as_secs();
    }

    /// Whatever an instance had is nobody's.
    fn free(&mut self, i: usize) {
        let row = &mut self.database.row;
        if row.owner.is_some_and(|(owner, _)| owner == i) {
            (row.owner, row.heir) = (None, None);
        }
    }

    fn renew(&mut self, i: usize) {
        if self.has_seat(i) {
            self.database.expires_at_s[i] = self.now_s + Self::lease_s();
            let trusted = Lease::trusted_after(Duration::from_secs(self.now_s));
            self.instances[i].trusted_until_s = trusted.as_secs();
        } else {
            let instance = &mut self.instances[i];
            (instance.incarnation, instance.tenure) = (None, None);
            instance.handing_over = false;
            instance.trusted_until_s = 0;
        }
    }

    fn may_take_for_dead(&self, by: usize, whom: usize) -> bool {
        by != whom
            && self.reaches(by)
            && self.has_seat(by)
            && self.database.incarnations[whom] > 0
            && self.database.expires_at_s[whom] <= self.now_s
            && self
                .database
                .row
                .owner
                .is_some_and(|(owner, _)| owner == whom)
    }

    fn claim(&mut self, i: usize, planted: Planted) {
        self.raise_epoch(planted);
        let row = &mut self.database.row;
        row.owner = self.instances[i].incarnation.map(|own| (i, own));
        row.heir = None;
        self.instances[i].tenure = Some(row.epoch);
    }

    fn raise_epoch(&mut self, planted: Planted) {
        let least = match planted {
            Planted::EpochWithoutTimeline => 0,
            _ => self.timeline * EPOCHS,
        };
        let row = &mut self.database.row;
        row.epoch = (row.epoch + 1).max(least);
    }

    /// The life of an instance that others may hand a robot to.
    fn live(&self, i: usize) -> Option<Seat> {
        let lives = self.database.incarnations[i] > 0 && self.database.expires_at_s[i] > self.now_s;
        lives.then_some((i, self.database.incarnations[i]))
    }

    /// Whether the rows name it as the heir of the robot, and it has said that it hears it.
    fn is_heir(&self, i: usize) -> Option<bool> {
        let own = self.instances[i].incarnation?;
        let (heir, ready) = self.database.row.heir?;
        (heir == (i, own) && self.has_seat(i)).then_some(ready)
    }

    /// Whether it can hand its robot over to an heir that hears it.
    fn has_ready_heir(&self, i: usize) -> bool {
        self.owns(i) && matches!(self.database.row.heir, Some((_, true)))
    }

    /// Passes the robot on to its heir, if that one is alive.
    fn hand_over(&mut self, i: usize, planted: Planted) {
        self.instances[i].handing_over = false;
        let Some((heir, _)) = self.database.row.heir.filter(|_| self.owns(i)) else {
            return;
        };
        if self.live(heir.0) == Some(heir) {
            if planted != Planted::HandedOverWithItsEpoch {
                self.raise_epoch(planted);
            }
            (self.database.row.owner, self.database.row.heir) = (Some(heir), None);
        }
    }

    /// Takes on the robot if it is its own by the rows, in the epoch that they say, and drops it if not.
    fn follow(&mut self, i: usize) {
        let tenure = self.owns(i).then_some(self.database.row.epoch);
        let instance = &mut self.instances[i];
        (instance.tenure, instance.handing_over) = (tenure, false);
    }

    fn owns(&self, i: usize) -> bool {
        let own = self.instances[i].incarnation;
        own.is_some_and(|own| self.database.row.owner == Some((i, own))) && self.has_seat(i)
    }

    /// Whether the database takes a write of this tenure: the seat is its instance's, and the robot
    /// that seat's, in this epoch.
    fn accepts(&self, i: usize, (incarnation, epoch): (Incarnation, u64)) -> bool {
        self.database.incarnations[i] == incarnation
            && self.database.row.owner == Some((i, incarnation))
            && self.database.row.epoch == epoch
    }

    fn accept(&mut self, i: usize, epoch: u64) {
        let kept = &mut self.database;
        self.late_writes += u8::from(epoch < kept.written);
        kept.written = kept.written.max(epoch);
        if !kept.writers.contains(&(epoch, i)) {
            kept.writers.push((epoch, i));
        }
    }

    /// A standby takes the primary's place. What it does not have is forgotten.
    fn fail_over(&mut self) {
        self.failovers_left -= 1;
        self.timeline += 1;
        self.database = self.standby.clone();
    }

    /// What comes of this world when nothing is hurt any more: whether the robot has an owner in
    /// the end that knows it.
    fn recovers(&self, planted: Planted) -> bool {
        let mut world = self.clone();
        for instance in &mut world.instances {
            (instance.frozen, instance.cut_off) = (false, false);
        }
        for _ in 0..Self::lease_s() {
            for i in 0..world.instances.len() {
                if world.instances[i].incarnation.is_none() {
                    world.join(i);
                }
                world.renew(i);
                for whom in 0..world.instances.len() {
                    if world.may_take_for_dead(i, whom) {
                        world.database.incarnations[whom] += 1;
                        world.free(whom);
                    }
                }
                if world.has_seat(i) && world.database.row.owner.is_none() {
                    world.claim(i, planted);
                }
                // What the rows say is its own, and it does not know, it takes on.
                if world.owns(i) {
                    world.instances[i].tenure = Some(world.database.row.epoch);
                }
            }
            world.now_s += STEP_S;
        }
        let owner = world.database.row.owner;
        owner.is_some_and(|(i, _)| {
            world.has_seat(i) && world.instances[i].tenure == Some(world.database.row.epoch)
        })
    }
}

impl Cluster {
    /// What an instance that reaches the database can do to hand the robot over, or to take it on.
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
            failovers_left: 1,
            freezes_left: 1,
            cuts_left: 1,
            moves_left: self.moves,
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
            if instance.frozen {
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
                world.instances[i].frozen = true;
            }
            Action::Thaw(i) => world.instances[i].frozen = false,
            Action::CutOff(i) => {
                world.cuts_left -= 1;
                world.instances[i].cut_off = true;
            }
            Action::Heal(i) => world.instances[i].cut_off = false,
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

/// Explores all that so many steps lead to, until something is wrong; gives the names of what was found, with the
/// number of states.
fn explore(model: Cluster, steps: usize) -> (Vec<&'static str>, usize) {
    // The initial state is at depth 1, and states at the largest depth are not looked at.
    let checker = model.checker().threads(2).target_max_depth(steps + 2);
    let checker = checker.finish_when(HasDiscoveries::AnyFailures);
    let checked = checker.spawn_bfs().join();
    let mut found: Vec<_> = checked.discoveries().into_keys().collect();
    found.sort_unstable();
    (found, checked.unique_state_count())
}

/// Steps to which everything is explored, unless the variable says otherwise.
fn steps(or: usize) -> usize {
    let steps = std::env::var("CLUSTER_MODEL_STEPS");
    steps.map_or(or, |steps| steps.parse().unwrap())
}

/// Two instances, without hand-overs.
fn pair(planted: Planted) -> Cluster {
    Cluster {
        planted,
        instances: 2,
        moves: 0,
        seconds_max: 12,
    }
}

fn assert_nothing_goes_wrong(model: Cluster, steps: usize) {
    let (found, states) = explore(model, steps);
    println!("{model:?}: {states} states in {steps} steps: {found:?}");
    assert!(states > 10_000, "{states} states");
    let wrong: Vec<_> = found
        .iter()
        .filter(|name| **name != "the robot changes hands")
        .collect();
    assert!(wrong.is_empty(), "{wrong:?}");
}

/// A second late put, which the gate prevents, takes 11 steps.
#[test]
fn there_are_never_two_accepted_writers_and_always_an_owner_in_the_end() {
    assert_nothing_goes_wrong(pair(Planted::Nothing), steps(12));
}

#[test]
fn nor_while_a_robot_is_handed_over() {
    let model = Cluster {
        moves: 1,
        ..pair(Planted::Nothing)
    };
    assert_nothing_goes_wrong(model, steps(11));
}

#[test]
fn nor_among_three() {
    let model = Cluster {
        instances: 3,
        moves: 1,
        ..pair(Planted::Nothing)
    };
    assert_nothing_goes_wrong(model, steps(9));
}

#[test]
fn each_part_of_the_mechanism_is_needed() {
    let with_its_epoch = Cluster {
        moves: 1,
        ..pair(Planted::HandedOverWithItsEpoch)
    };
    for (model, expected) in [
        (
            pair(Planted::NoFence),
            "no write after one of a later tenure",
        ),
        (pair(Planted::NoGate), "one late put at the most"),
        (pair(Planted::EpochWithoutTimeline), "one instance an epoch"),
        (with_its_epoch, "one instance an epoch"),
    ] {
        let (found, states) = explore(model, 12);
        assert!(
            found.contains(&expected),
            "{model:?}: {found:?} in {states} states"
        );
    }
}
