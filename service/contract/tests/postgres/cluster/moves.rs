//! Moves of robots and duties among instances.

use std::collections::BTreeSet;

use fleetcal_cluster::{ClaimId, Duty, Seat};
use fleetcal_contract::robot;
use fleetcal_model::{RobotId, RobotTime};
use tokio::time::Instant as Time;

use super::instance::{Instance, database, end_lease};
use crate::proxy::Proxy;
use fleetcal_contract::own_server::psql;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn two_that_claim_the_same_robots_get_different_ones() {
    let (url, robots) = database(200).await;
    let a = Instance::join(&url, "a").await;
    let b = Instance::join(&url, "b").await;
    let mut of_a = 0;
    for round in 0..20 {
        let (by_a, by_b) = tokio::join!(
            a.claim(&robots, 1_000 * round),
            b.claim(&robots, 1_000 * round + 500)
        );
        let names = |tenures: &[fleetcal_cluster::Tenure]| -> BTreeSet<RobotId> {
            tenures.iter().map(|tenure| tenure.robot.clone()).collect()
        };
        let (got_a, got_b) = (names(&by_a), names(&by_b));
        assert!(got_a.is_disjoint(&got_b));
        // One that both wanted at the same moment is left for the next look.
        let (rest_a, rest_b) = (
            a.claim(&robots, 1_000 * round + 200).await,
            b.claim(&robots, 1_000 * round + 700).await,
        );
        let all = by_a.len() + by_b.len() + rest_a.len() + rest_b.len();
        assert_eq!(all, robots.len());
        of_a += by_a.len();
        a.registry.free(&a.seat, &robots).await.unwrap();
        b.registry.free(&b.seat, &robots).await.unwrap();
    }
    println!("20 rounds, {of_a} of 4,000 robots went to the first at once");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn four_thousand_robots_are_claimed_and_looked_at_within_a_statement_s_time() {
    let (url, robots) = database(4_096).await;
    let a = Instance::join(&url, "a").await;
    let began = Time::now();
    assert_eq!(a.claim(&robots, 1).await.len(), robots.len());
    let claimed = began.elapsed();
    let began = Time::now();
    let look = a.look().await;
    assert!(look.is_whole && look.snapshot.robots.len() == robots.len());
    println!(
        "4,096 robots: claimed in {claimed:?}, looked at in {:?}",
        began.elapsed()
    );
    a.registry.leave(&a.seat).await.unwrap();
    assert_eq!(a.robots().await, BTreeSet::new());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_look_reads_robots_when_they_have_changed_and_not_for_a_renewal() {
    let (url, robots) = database(3).await;
    let a = Instance::join(&url, "a").await;
    let first = a.look().await;
    assert!(a.renew().await);
    let again = a.registry.look(Some(first.version)).await.unwrap();
    assert!(!again.is_whole && again.snapshot.robots.is_empty());
    assert_eq!(
        again.snapshot.members.len(),
        1,
        "instances are always there"
    );
    a.claim(&robots[..1], 1).await;
    let changed = a.registry.look(Some(first.version)).await.unwrap();
    assert!(changed.is_whole && changed.version > first.version);
    assert_eq!(changed.snapshot.robots.len(), 3);
    // A robot that somebody describes.
    let sql = "INSERT INTO robot (id, config, created_ns, updated_ns) VALUES ('new', '{}', 0, 0),
        ('seen', NULL, 0, 0)";
    psql(&url, sql);
    let added = a.registry.look(Some(changed.version)).await.unwrap();
    let names: Vec<_> = added.snapshot.robots.keys().map(RobotId::as_str).collect();
    assert_eq!(names, ["new", "robot_000", "robot_001", "robot_002"]);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_look_over_a_connection_that_was_lost_reads_all_over_a_new_one() {
    let (url, _) = database(3).await;
    let (proxy, behind_proxy) = Proxy::before_database(&url).await;
    let a = Instance::join(&behind_proxy, "a").await;
    let first = a.look().await;
    for _ in 0..3 {
        proxy.lose_clients();
        let again = a.registry.look(Some(first.version)).await.unwrap();
        assert!(again.is_whole && again.snapshot.robots.len() == 3);
        let third = a.registry.look(Some(first.version)).await.unwrap();
        assert!(!third.is_whole && third.snapshot.members.len() == 1);
    }
}

/// Measures the cost of a look while nothing happens; each instance looks four times a second.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_look_at_what_has_not_changed_is_one_round_trip() {
    let (url, _) = database(3).await;
    let (proxy, behind_proxy) = Proxy::before_database(&url).await;
    let a = Instance::join(&behind_proxy, "a").await;
    let first = a.look().await;
    let look = async || {
        let before = proxy.round_trips();
        let seen = a.registry.look(Some(first.version)).await.unwrap();
        assert!(!seen.is_whole && seen.snapshot.members.len() == 1);
        proxy.round_trips() - before
    };
    for _ in 0..20 {
        assert_eq!(look().await, 1);
    }
}

/// Names the other instance as heir of all robots, and marks it as ready.
async fn name(owner: &Instance, heir: &Instance, robots: &[RobotId]) {
    let named: Vec<_> = robots
        .iter()
        .map(|robot| (robot.clone(), Some(heir.seat.clone())))
        .collect();
    owner
        .registry
        .name_heirs(&owner.seat, &named)
        .await
        .unwrap();
    heir.registry.note_ready(&heir.seat, robots).await.unwrap();
}

async fn hand_over(owner: &Instance, to: &Seat, robots: &[RobotId]) -> Vec<RobotId> {
    let handed: Vec<_> = robots
        .iter()
        .zip(100..)
        .map(|(robot, claim)| (robot.clone(), to.clone(), ClaimId(claim)))
        .collect();
    let went = owner.registry.hand_over(&owner.seat, &handed).await;
    let mut went = went.unwrap();
    went.sort();
    went
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_is_handed_over_to_its_heir_alone_and_only_while_that_one_lives() {
    let (url, robots) = database(4).await;
    let a = Instance::join(&url, "a").await;
    let b = Instance::join(&url, "b").await;
    let c = Instance::join(&url, "c").await;
    let before = a.claim(&robots, 1).await;
    name(&a, &b, &robots[..3]).await;
    let rows = a.look().await.snapshot.robots;
    assert!(
        robots[..3]
            .iter()
            .all(|robot| rows[robot].heir_ready.is_some())
    );
    // Named again, it stays ready.
    let again = [
        (robots[0].clone(), Some(b.seat.clone())),
        (robots[2].clone(), None),
    ];
    a.registry.name_heirs(&a.seat, &again).await.unwrap();
    let rows = a.look().await.snapshot.robots;
    assert!(rows[&robots[0]].heir_ready.is_some() && rows[&robots[2]].heir.is_none());

    assert_eq!(hand_over(&a, &c.seat, &robots).await, [], "not the heir");
    assert_eq!(hand_over(&b, &b.seat, &robots).await, [], "not the owner");
    end_lease(&url, "b");
    assert_eq!(hand_over(&a, &b.seat, &robots).await, [], "not alive");
    assert!(b.renew().await);
    assert_eq!(hand_over(&a, &b.seat, &robots).await, robots[..2]);
    let rows = a.look().await.snapshot.robots;
    for (robot, tenure) in robots.iter().zip(&before[..]).take(2) {
        assert_eq!(rows[robot].owner.as_ref(), Some(&b.seat));
        assert!(rows[robot].epoch > tenure.epoch && rows[robot].heir.is_none());
    }
    let claims: Vec<_> = robots[..2].iter().map(|robot| rows[robot].claim).collect();
    assert_eq!(claims, [ClaimId(100), ClaimId(101)]);
    assert_eq!(rows[&robots[3]].owner.as_ref(), Some(&a.seat));

    // An heir that is taken for dead is none any more.
    name(&a, &b, &robots[3..]).await;
    end_lease(&url, "b");
    let dead = fleetcal_store::cluster::TakeForDead::LeaseEnded;
    let taken = c.registry.take_for_dead(&c.seat, dead).await.unwrap();
    assert_eq!(taken, std::slice::from_ref(&b.seat));
    let rows = a.look().await.snapshot.robots;
    assert_eq!(rows[&robots[3]].heir, None);
    assert_eq!(rows[&robots[0]].owner, None);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_cannot_read_a_state_does_not_get_its_robot() {
    let (url, robots) = database(4).await;
    let a = Instance::join(&url, "a").await;
    let tenures = a.claim(&robots, 1).await;
    assert_eq!(tenures.len(), 4);
    let states: [&[u8]; 3] = [&[3, 1], &[2, 1], b"{\"former\": 1}"];
    for (robot, state) in robots.iter().zip(states) {
        a.store.save_checkpoint(robot, RobotTime(7), state.to_vec());
    }
    a.store.flush().await.unwrap();
    a.registry.free(&a.seat, &robots).await.unwrap();
    let rows = a.look().await.snapshot.robots;
    let formats: Vec<_> = rows.values().map(|row| row.checkpoint_format).collect();
    assert_eq!(formats, [3, 2, 1, 0]);
    // It reads formats up to 2.
    let got: BTreeSet<_> = a
        .claim(&robots, 10)
        .await
        .into_iter()
        .map(|one| one.robot)
        .collect();
    assert_eq!(got, robots[1..].iter().cloned().collect());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_duty_is_one_instance_s_until_it_gives_it_up_or_ends() {
    let (url, _) = database(1).await;
    let a = Instance::join(&url, "a").await;
    let b = Instance::join(&url, "b").await;
    let all = Duty::ALL;
    let claim = async |one: &Instance| {
        let got = one.registry.claim_duties(&one.seat, all).await.unwrap();
        got.into_iter().collect::<BTreeSet<_>>()
    };
    assert_eq!(claim(&a).await.len(), 4);
    assert_eq!(claim(&b).await, BTreeSet::new());
    b.registry.free_duties(&b.seat, all).await.unwrap();
    a.registry
        .free_duties(&a.seat, &[Duty::Alerts])
        .await
        .unwrap();
    assert_eq!(claim(&b).await, BTreeSet::from([Duty::Alerts]));
    a.registry.leave(&a.seat).await.unwrap();
    let rows = b.look().await.snapshot;
    assert!(rows.members.iter().all(|member| member.seat == b.seat));
    assert_eq!(claim(&b).await.len(), 3);
    let unknown = b.claim(&[robot("nobody_knows_it")], 1).await;
    assert_eq!(unknown, []);
}
