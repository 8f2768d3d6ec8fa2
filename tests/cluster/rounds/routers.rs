//! Routers that are killed: whoever was at one connects to the other; and routers that are cut from each
//! other.

use std::time::Duration;

use fleetcal_contract::own_server::psql;
use fleetcal_tests::service::{now, wait_for};
use serde_json::Value;

use crate::cluster::{Cluster, Instance};
use crate::figures::{quantile, spread};
use crate::network::{Cut, Line};
use crate::progress::Progress;
use crate::trial::SERVED_WITHIN;
use crate::watch::Watch;

const ROBOTS: usize = 6;

/// Kills a router and starts it again; returns the time until the last robot's estimates came, s.
async fn kill(cluster: &mut Cluster, router: usize, seed: u64) -> f64 {
    let other = &cluster.routers[1 - router..][..1];
    let watch = Watch::start(other).await;
    let killed = now();
    cluster.kill_router(router);
    // What has come right after that was on its way.
    std::thread::sleep(Duration::from_millis(1_200));
    let since = now();
    let came = wait_for("estimates of all robots", || {
        let came = watch.first_since(since);
        (came.len() == ROBOTS).then_some(came)
    });
    let took = came.into_values().map(|at| at - killed).max().unwrap();
    let stale = watch.stale(killed);
    assert!(stale.values().all(|count| *count <= 1), "{stale:?}");
    cluster.start_router(router);
    println!("round {seed}: router {router} killed, all estimates again after {took:.2?}");
    took.as_secs_f64()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn robots_are_served_over_the_other_router_when_theirs_is_killed() {
    let mut progress = Progress::of("router_killed", 2);
    let open = progress.open();
    if !open.is_empty() {
        let mut cluster = Cluster::new(&["a", "b"], ROBOTS).await;
        let _a = cluster.start("a", 0);
        let b = cluster.start("b", 1);
        let _robots = cluster.drive();
        let even = || {
            let shares = b.shares()?;
            let even = shares.values().all(|share| *share == ROBOTS as u64 / 2);
            (even && shares.len() == 2).then_some(())
        };
        for seed in open {
            progress.begin(seed);
            wait_for("even shares", even);
            // Robots and instances have been at router 0 at first, and are all at the other one then.
            let router = (seed + 1) % 2;
            let took = kill(&mut cluster, router as usize, seed).await;
            wait_for("even shares", even);
            progress.passed(seed, vec![took]);
            // The next router is killed when everybody knows this one again.
            std::thread::sleep(Duration::from_secs(5));
        }
        let server = psql(&cluster.records(), "SHOW server_version");
        println!("router_killed: {}", progress.told(server.trim()));
    }
    let took = progress.figures(0);
    println!(
        "a router killed, until all robots are served: {}",
        spread(&took)
    );
    println!("  failed or broken off: {}", progress.told_failed());
    assert!(
        quantile(&took, 1.0) <= SERVED_WITHIN.as_secs_f64(),
        "{took:?}"
    );
}

/// Time within which robots are served when the routers are cut from each other.
const HEARD_WITHIN: Duration = Duration::from_secs(10);
/// Time after that in which nothing moves.
const CUT_FOR: Duration = Duration::from_secs(25);

/// Returns the instances that some of them do not hear.
fn unheard(instance: &Instance) -> Option<Vec<(String, String)>> {
    let cluster = instance.try_get("/api/v1/cluster")?;
    let names = |one: &Value| {
        let name = one["name"].as_str()?.to_owned();
        let others = one["unheard"].as_array()?.iter();
        Some(
            others
                .filter_map(|other| Some((name.clone(), other.as_str()?.to_owned())))
                .collect(),
        )
    };
    let all: Option<Vec<Vec<_>>> = cluster["instances"].as_array()?.iter().map(names).collect();
    Some(all?.concat())
}

/// Cuts the routers from each other; returns the time until the last robot's estimates came, s.
async fn part(cluster: &Cluster, lines: &[Line], a: &Instance, seed: u64) -> f64 {
    // The robots are at the first router, and so is a.
    let watch = Watch::start(&cluster.routers[..1]).await;
    let cut = now();
    for line in lines {
        line.cut(Cut::Both);
    }
    // What has come right after that was on its way.
    std::thread::sleep(Duration::from_millis(200));
    let since = now();
    let came = wait_for("estimates of all robots", || {
        let came = watch.first_since(since);
        (came.len() == ROBOTS).then_some(came)
    });
    let took = came.into_values().map(|at| at - cut).max().unwrap();
    let named = wait_for("both say so", || {
        unheard(a).filter(|pairs| pairs.len() == 2)
    });
    let moved = a.shares().unwrap();
    std::thread::sleep(CUT_FOR.saturating_sub(cut.elapsed()));
    assert_eq!(a.shares().unwrap(), moved, "robots go to and fro");
    for line in lines {
        line.heal();
    }
    println!("round {seed}: {named:?}, shares {moved:?}, all estimates again after {took:.2?}");
    took.as_secs_f64()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn robots_are_served_by_who_hears_them_when_the_routers_are_cut() {
    let mut progress = Progress::of("routers_cut", 1);
    let open = progress.open();
    if !open.is_empty() {
        let mut cluster = Cluster::new(&["a", "b"], ROBOTS).await;
        let lines = cluster.part_routers().await;
        let a = cluster.start("a", 0);
        let _b = cluster.start("b", 1);
        let _robots = cluster.drive();
        let even = || {
            let shares = a.shares()?;
            let even = shares.values().all(|share| *share == ROBOTS as u64 / 2);
            let all_heard = unheard(&a)?.is_empty();
            (even && all_heard && shares.len() == 2).then_some(())
        };
        for seed in open {
            progress.begin(seed);
            wait_for("even shares", even);
            std::thread::sleep(Duration::from_secs(5));
            let took = part(&cluster, &lines, &a, seed).await;
            wait_for("even shares", even);
            progress.passed(seed, vec![took]);
        }
        let server = psql(&cluster.records(), "SHOW server_version");
        println!("routers_cut: {}", progress.told(server.trim()));
    }
    let took = progress.figures(0);
    println!(
        "routers cut from each other, until all robots are served: {}",
        spread(&took)
    );
    println!("  failed or broken off: {}", progress.told_failed());
    assert!(
        quantile(&took, 1.0) <= HEARD_WITHIN.as_secs_f64(),
        "{took:?}"
    );
}
