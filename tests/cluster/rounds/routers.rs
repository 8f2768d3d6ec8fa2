//! Routers that are killed: whoever was at one connects to the other.

use std::time::Duration;

use fleetcal_contract::own_server::psql;
use fleetcal_tests::service::{now, wait_for};

use crate::cluster::Cluster;
use crate::figures::{quantile, spread};
use crate::progress::Progress;
use crate::trial::SERVED_WITHIN;
use crate::watch::Watch;

const ROBOTS: usize = 6;

/// Kills a router and starts it again; gives how long after that the last robot's estimates came, s.
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
