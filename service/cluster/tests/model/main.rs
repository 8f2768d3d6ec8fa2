//! Model of lease, epoch and fence, explored state by state: instances are frozen, disconnected
//! from the database and killed at any step, a robot is handed over meanwhile, and the database
//! loses its latest commits in a failover.
//!
//! One step of time is two seconds. One transaction of the database is one action here, as in
//! `service/postgres`; two transactions of an instance are two, so that it can be frozen between
//! them.
#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test that cannot go on fails, and says what it has counted"
)]

mod cluster;
mod world;

use stateright::{Checker as _, HasDiscoveries, Model as _};

use crate::cluster::Cluster;
use crate::world::Planted;

/// Explores all states within this many steps, until a property fails; returns the names of the
/// failed ones, with the number of states.
fn explore(model: Cluster, steps: usize) -> (Vec<&'static str>, usize) {
    // The initial state is at depth 1, and states at the largest depth are not looked at.
    let checker = model.checker().threads(2).target_max_depth(steps + 2);
    let checker = checker.finish_when(HasDiscoveries::AnyFailures);
    let checked = checker.spawn_bfs().join();
    let mut found: Vec<_> = checked.discoveries().into_keys().collect();
    found.sort_unstable();
    (found, checked.unique_state_count())
}

/// Number of steps of the exploration, unless the variable sets another one.
fn steps(or: usize) -> usize {
    let steps = std::env::var("CLUSTER_MODEL_STEPS");
    steps.map_or(or, |steps| steps.parse().unwrap())
}

/// Model of two instances, without hand-overs.
fn pair(planted: Planted) -> Cluster {
    Cluster {
        planted,
        instances: 2,
        moves: 0,
        failovers: 1,
        freezes: 1,
        cuts: 1,
        kills: 0,
        seconds_max: 12,
    }
}

/// Model of this many instances, in which the robot may be handed over once.
fn with_a_move(instances: usize, planted: Planted) -> Cluster {
    Cluster {
        instances,
        moves: 1,
        ..pair(planted)
    }
}

/// Model of two instances, one of which may be killed once, and is replaced before its lease ends.
fn with_a_kill(planted: Planted) -> Cluster {
    Cluster {
        kills: 1,
        ..pair(planted)
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

/// Property of the unplanted model. A second late put, which the gate prevents, takes 11 steps.
#[test]
fn there_are_never_two_accepted_writers_and_always_an_owner_in_the_end() {
    assert_nothing_goes_wrong(pair(Planted::Nothing), steps(12));
}

#[test]
fn nor_while_a_robot_is_handed_over() {
    assert_nothing_goes_wrong(with_a_move(2, Planted::Nothing), steps(11));
}

#[test]
fn nor_among_three() {
    assert_nothing_goes_wrong(with_a_move(3, Planted::Nothing), steps(9));
}

#[test]
fn nor_where_a_killed_instance_is_replaced_at_once() {
    assert_nothing_goes_wrong(with_a_kill(Planted::Nothing), steps(11));
}

/// Each planted fault shows under one disturbance alone, or under none.
#[test]
fn each_part_of_the_mechanism_is_needed() {
    let undisturbed = |model| Cluster {
        failovers: 0,
        freezes: 0,
        cuts: 0,
        ..model
    };
    let with_a_freeze = |planted| Cluster {
        freezes: 1,
        ..undisturbed(pair(planted))
    };
    let with_a_failover = |planted| Cluster {
        failovers: 1,
        ..undisturbed(pair(planted))
    };
    for (model, expected) in [
        (
            with_a_freeze(Planted::NoFence),
            "no write after one of a later tenure",
        ),
        (with_a_freeze(Planted::NoGate), "one late put at the most"),
        (
            with_a_failover(Planted::EpochWithoutTimeline),
            "one instance an epoch",
        ),
        (
            undisturbed(with_a_move(2, Planted::HandedOverWithItsEpoch)),
            "one instance an epoch",
        ),
    ] {
        let (found, states) = explore(model, 12);
        println!("{:?}: {found:?} in {states} states", model.planted);
        assert!(
            found.contains(&expected),
            "{model:?}: {found:?} in {states} states"
        );
    }
}
