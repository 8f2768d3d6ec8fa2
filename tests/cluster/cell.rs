//! A cell as large as one may be: many robots that stand, some that drive, and an instance that joins
//! and one that dies.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use fleetcal_contract::own_server::{number, psql};
use fleetcal_domain::limits::ROBOTS_MAX;
use fleetcal_tests::service::now;

use crate::cluster::{Cluster, Instance, Parts};
use crate::watch::Watch;

/// Driving robots.
const DRIVING: usize = 60;
/// Time after a start, a joining or an end within which all robots have an instance, each with its
/// even share.
const CLAIMED_WITHIN: Duration = Duration::from_secs(30);
/// Limit at which a wait gives up: longer times than allowed are reported before.
const WAIT_MAX: Duration = Duration::from_mins(3);
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// Most robots that may move to a joining instance, as a multiple of its even share.
const MOVED_SHARE_MAX: f64 = 1.2;

/// Waits for a condition; returns the time that passed since.
fn after(since: Instant, what: &str, is_there: impl Fn() -> Option<bool>) -> Duration {
    let began = now();
    while is_there() != Some(true) {
        assert!(
            began.elapsed() < WAIT_MAX,
            "{what} did not come within {WAIT_MAX:?}"
        );
        std::thread::sleep(LOOK_EVERY);
    }
    since.elapsed()
}

/// Waits until this number of instances share all robots evenly; returns the time that passed
/// since.
fn shared(seen_by: &Instance, instances: usize, robots: usize, since: Instant) -> Duration {
    after(since, "even shares", || {
        let mut shares = seen_by.shares()?;
        // One that has ended is shown for a while.
        shares.retain(|_, share| *share > 0);
        let (least, most) = (shares.values().min()?, shares.values().max()?);
        let all: u64 = shares.values().sum();
        Some(most - least <= 1 && all == robots as u64 && shares.len() == instances)
    })
}

/// Waits for the estimates of all driving robots; returns the time that passed since.
fn estimated(watch: &Watch, since: Instant) -> Duration {
    after(since, "estimates of all", || {
        Some(watch.owners(since).len() == DRIVING)
    })
}

/// Returns the instance of each robot, by the database.
fn owners(cluster: &Cluster) -> BTreeMap<String, String> {
    let told = psql(
        &cluster.database().parse().unwrap(),
        "SELECT robot, coalesce(instance, '') FROM robot_owner",
    );
    let owner = |line: &str| {
        let (robot, instance) = line.split_once('|')?;
        Some((robot.to_owned(), instance.to_owned()))
    };
    told.lines().filter_map(owner).collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_cell_has_as_many_robots_as_may_be() {
    let robots = number("CLUSTER_CELL_ROBOTS", ROBOTS_MAX);
    let cluster = Cluster::of(&Parts {
        names: vec!["a", "b", "c"],
        robots: DRIVING,
        parked: robots - DRIVING,
        robots_apply: false,
        fast_takeover: true,
        in_namespaces: false,
    })
    .await;
    let watch = Watch::start(&cluster.routers).await;
    let began = now();
    let mut a = cluster.start("a", 0);
    let b = cluster.start("b", 1);
    let ready = now();
    let claimed = shared(&b, 2, robots, ready);
    println!(
        "{robots} robots: two instances ready after {:.1?}, all claimed and shared {claimed:.1?} later",
        ready - began
    );

    let drive = now();
    let _robots = cluster.drive();
    let heard = estimated(&watch, drive);
    println!("{DRIVING} of them drive, all estimated after {heard:.1?}");

    let before = owners(&cluster);
    let joining = now();
    let c = cluster.start("c", 0);
    let ready_c = now();
    let joined = shared(&c, 3, robots, ready_c);
    let owners_then = owners(&cluster);
    let moved = before
        .iter()
        .filter(|(robot, owner)| owners_then[*robot] != **owner);
    let moved = moved.count();
    println!(
        "a third instance ready after {:.1?}, shared {joined:.1?} later, {moved} robots moved",
        ready_c - joining
    );
    let longest = watch.gaps(joining).into_values().max().unwrap();
    println!("longest time without an estimate meanwhile: {longest:.2?}");

    let killed = now();
    a.process.kill();
    let left = shared(&c, 2, robots, killed);
    let again = estimated(&watch, now());
    let longest = watch.gaps(killed).into_values().max().unwrap();
    println!(
        "one killed: shared by two after {left:.1?}, all estimated {again:.1?} later, longest time \
         without an estimate {longest:.2?}"
    );

    for took in [claimed, joined, left] {
        assert!(took <= CLAIMED_WITHIN, "{took:?}");
    }
    let moves_max = MOVED_SHARE_MAX * robots as f64 / 3.0;
    assert!(
        moved as f64 <= moves_max,
        "{moved} of {robots} robots moved"
    );
}
