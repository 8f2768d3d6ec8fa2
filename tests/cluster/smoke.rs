//! Rounds that every change has to pass.

use std::collections::BTreeMap;
use std::time::Duration;

use fleetcal_tests::http;
use fleetcal_tests::service::{now, wait_for};

use crate::cluster::{Cluster, Instance};
use crate::stream;
use crate::watch::Watch;

const ROBOTS: usize = 6;
/// Time within which a takeover shows by the next estimate, one a second.
const TAKEN_OVER_WITHIN: Duration = Duration::from_secs(9);
const BALANCED_WITHIN: Duration = Duration::from_secs(30);

/// Waits until the instances share the robots evenly; returns the time that took.
fn balanced(seen_by: &Instance, instances: usize) -> Duration {
    let began = now();
    wait_for("even shares", || {
        let shares = seen_by.shares()?;
        let even = shares
            .values()
            .all(|share| *share == (ROBOTS / instances) as u64);
        (shares.len() == instances && even).then_some(())
    });
    began.elapsed()
}

/// Waits until every robot's estimates come, each from one instance; returns those instances.
fn owners(watch: &Watch) -> BTreeMap<String, String> {
    wait_for("estimates of all robots", || {
        std::thread::sleep(Duration::from_secs(3));
        let owners = watch.owners(now().checked_sub(Duration::from_millis(2_500))?);
        let one = |(robot, of): (String, std::collections::BTreeSet<String>)| {
            (of.len() == 1).then(|| Some((robot, of.first()?.clone())))?
        };
        let owners: Option<BTreeMap<_, _>> = owners.into_iter().map(one).collect();
        owners.filter(|owners| owners.len() == ROBOTS)
    })
}

fn of_instance(owners: &BTreeMap<String, String>, name: &str) -> Vec<String> {
    let own = owners.iter().filter(|(_, owner)| *owner == name);
    own.map(|(robot, _)| robot.clone()).collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn instances_share_the_robots_and_take_over_from_each_other() {
    let cluster = Cluster::new(&["a", "b"], ROBOTS).await;
    let watch = Watch::start(&cluster.routers).await;
    let mut a = cluster.start("a", 0);
    let _robots = cluster.drive();
    let of_one = owners(&watch);
    assert_eq!(of_instance(&of_one, "a").len(), ROBOTS);

    // One joins: robots move without a break.
    let joined = now();
    let b = cluster.start("b", 1);
    let took = balanced(&b, 2);
    assert!(took < BALANCED_WITHIN, "balanced after {took:?}");
    let of_two = owners(&watch);
    let (of_a, of_b) = (of_instance(&of_two, "a"), of_instance(&of_two, "b"));
    assert_eq!((of_a.len(), of_b.len()), (ROBOTS / 2, ROBOTS / 2));
    let gap = watch.gaps(joined).into_values().max().unwrap();
    assert!(
        gap <= Duration::from_millis(2_200),
        "{gap:?} without an estimate"
    );
    assert_eq!(watch.stale(joined), BTreeMap::new());

    any_instance_answers(&a, &b, &of_a, &of_b);
    tries_to_sign_in_count_at_both(&a, &b);
    a_frozen_instance_is_fenced(&cluster, &watch, &a, &b, &of_a);

    // Killed: the other one goes on.
    let owners_before = owners(&watch);
    let of_a = of_instance(&owners_before, "a");
    let killed = now();
    a.process.kill();
    let took = wait_for("a takeover", || watch.taken_over(killed, "a", &of_a));
    println!("taken over after kill -9: {took:?}");
    assert!(
        took.iter().all(|took| *took < TAKEN_OVER_WITHIN),
        "{took:?}"
    );
    assert_eq!(watch.stale(killed), BTreeMap::new());

    // It comes back, and ends in order: nothing is lost on the way.
    let mut a = cluster.start("a", 0);
    assert!(balanced(&b, 2) < BALANCED_WITHIN);
    owners(&watch);
    let stopped = now();
    a.process.end_in_order();
    let all = owners(&watch);
    assert_eq!(of_instance(&all, "b").len(), ROBOTS);
    let gap = watch.gaps(stopped).into_values().max().unwrap();
    println!("longest time without an estimate at a planned end: {gap:?}");
    assert!(
        gap <= Duration::from_millis(2_200),
        "{gap:?} without an estimate"
    );
}

/// Checks that lists and live updates show all robots on either instance, and that requests about a
/// robot are forwarded to its instance.
fn any_instance_answers(a: &Instance, b: &Instance, of_a: &[String], of_b: &[String]) {
    for instance in [a, b] {
        wait_for("all robots on one page", || {
            let list = instance.try_get("/api/v1/robots?limit=100")?;
            let robots = list["items"].as_array()?.clone();
            let fresh = robots.iter().filter(|robot| robot["stale"] == false);
            (fresh.count() == ROBOTS).then_some(())
        });
        let told = stream::robots_told(instance, ROBOTS);
        assert_eq!(told.len(), ROBOTS, "{}: {told:?}", instance.name);
        for robot in of_a.iter().chain(of_b) {
            let view = instance.get(&format!("/api/v1/robots/{robot}/top-view"));
            assert!(view["returns_m"].as_array().is_some(), "{robot}: {view}");
            let estimate = instance.get(&format!("/api/v1/robots/{robot}/estimate"));
            assert_eq!(estimate["robot"], *robot);
        }
    }
}

/// Checks that ten wrong passwords for a name are too many, though each instance has received half
/// of them.
fn tries_to_sign_in_count_at_both(a: &Instance, b: &Instance) {
    let try_at = |instance: &Instance| {
        let wrong = r#"{"name": "nobody", "password": "not the password"}"#;
        let answer = http::send(
            instance.http,
            "POST /api/v1/session",
            None,
            Some(("", wrong)),
        );
        answer.unwrap().status
    };
    for instance in [a, b].repeat(5) {
        assert_eq!(try_at(instance), 401, "{}", instance.name);
    }
    assert_eq!([try_at(a), try_at(b)], [429, 429]);
}

/// Freezes an instance for longer than its lease: it loses its robots and notices it when it is
/// resumed.
fn a_frozen_instance_is_fenced(
    cluster: &Cluster,
    watch: &Watch,
    a: &Instance,
    b: &Instance,
    of_a: &[String],
) {
    let frozen = now();
    a.process.signal("STOP");
    let took = wait_for("a takeover", || watch.taken_over(frozen, "a", of_a));
    println!("taken over from a frozen instance: {took:?}");
    std::thread::sleep(Duration::from_secs(2));
    a.process.signal("CONT");
    assert!(balanced(b, 2) < BALANCED_WITHIN);
    owners(watch);
    let stale = watch.stale(frozen);
    assert!(stale.values().all(|count| *count <= 1), "{stale:?}");
    assert!(
        took.iter().all(|took| *took < TAKEN_OVER_WITHIN),
        "{took:?}"
    );
    assert!(cluster.folder().exists());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_does_not_fit_does_not_start() {
    let cluster = Cluster::new(&["a", "b"], 1).await;
    let a = cluster.start("a", 0);
    // The same name again.
    let mut twin = cluster.spawn("twin", 0, &["--instance", "a", "--http", "127.0.0.1:0"]);
    assert_eq!(twin.ended(), Some(74), "{}", twin.said());
    // A service that takes itself for the only one.
    let mut single = cluster.spawn("single", 0, &["--http", "127.0.0.1:0"]);
    assert_eq!(single.ended(), Some(74), "{}", single.said());
    // One that signs with another key.
    std::fs::write(cluster.folder().join("signing.key"), [7; 32]).unwrap();
    let mut other = cluster.spawn("b", 0, &["--instance", "b", "--http", "127.0.0.1:0"]);
    assert_eq!(other.ended(), Some(74), "{}", other.said());
    assert!(
        a.get("/api/v1/cluster")["instances"]
            .as_array()
            .unwrap()
            .len()
            == 1
    );
    assert!(!cluster.database().is_empty());
    assert_eq!(a.name, "a");
}
