//! A PostgreSQL whose postmaster is killed under decisions.

use std::time::Duration;

use fleetcal_tests::service::{now, wait_for};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

use crate::cluster::{Cluster, Parts};
use crate::figures::{quantile, spread, told};
use crate::namespaces;
use crate::progress::Progress;
use crate::records;
use crate::trial::{DECIDERS, DECIDERS_PAUSE, Trial, assert_rate};

/// Time after the server's return within which decisions are taken again, s.
const AGAIN_WITHIN_S: f64 = 5.0;

/// Kills the postmaster, every second time with all of its processes, and starts the server again;
/// returns the time without decisions after that, s, the number of decisions acknowledged in the
/// round, and their rate before.
fn kill(trial: &Trial, seed: u64) -> [f64; 3] {
    let mut random = StdRng::seed_from_u64(seed);
    let before = trial.decider.acknowledged();
    let rate = trial.decisions_per_s(Duration::from_millis(random.random_range(3_000..6_000)));
    assert_rate(rate);
    let server = trial.cluster.server.as_ref().unwrap();
    let whole = seed.is_multiple_of(2);
    if whole {
        records::kill_processes(&trial.url());
    } else {
        server.kill();
    }
    std::thread::sleep(Duration::from_millis(random.random_range(0..4_000)));
    server.start();
    let back = now();
    let decided = wait_for("a decision", || trial.decider.acknowledged_since(back)) - back;
    let count = trial.decider.acknowledged() - before;
    trial.balanced();
    trial.owners();
    trial.check(seed);
    println!(
        "round {seed}: {rate:.0} decisions a second before, {count} acknowledged, the next one {decided:.2?} \
         after the return"
    );
    [decided.as_secs_f64(), count as f64, rate]
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_killed_postmaster_loses_nothing_acknowledged() {
    let mut progress = Progress::of("postmaster", 2);
    let open = progress.open();
    if !open.is_empty() {
        let parts = Parts {
            parked: DECIDERS,
            in_namespaces: namespaces::may_be_made(),
            ..Trial::parts(true)
        };
        let cluster = Cluster::watched(&parts).await;
        let trial = Trial::on(cluster, &parts, open[0], DECIDERS_PAUSE).await;
        for seed in open {
            progress.begin(seed);
            let took = kill(&trial, seed);
            progress.passed(seed, took.to_vec());
        }
        println!(
            "postmaster: {}; {}",
            trial.seen(),
            progress.told(&trial.server())
        );
    }
    let again = progress.figures(0);
    println!(
        "decisions again after the server's return: {}",
        spread(&again)
    );
    println!(
        "  with a lost decision or other faults: {}",
        progress.told_failed()
    );
    println!(
        "  decisions lost in rounds that passed: {}",
        told(0, progress.count(1))
    );
    assert!(quantile(&again, 1.0) <= AGAIN_WITHIN_S, "{again:?}");
}
