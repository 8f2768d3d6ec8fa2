//! Instances that are cut off from the database or from their router, in both directions or in one;
//! and instances whose lines are slow.
//!
//! As root, each instance has a network namespace of its own, and a cut loses its packets. Else a TCP
//! proxy holds the bytes back.

use std::time::Duration;

use fleetcal_tests::service::now;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

use crate::cluster::{Cluster, Parts};
use crate::figures::{quantile, spread};
use crate::namespaces;
use crate::network::Cut;
use crate::progress::Progress;
use crate::records;
use crate::trial::{BALANCED_WITHIN, SERVED_WITHIN, Trial};

const PAUSE: Duration = Duration::from_millis(200);
/// Largest additional delay of a line, in each direction, ms.
const DELAY_MAX_MS: u64 = 400;
/// Duration of the delay.
const SLOW_FOR: Duration = Duration::from_secs(15);

/// Counterpart from which an instance is cut off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum From {
    Database,
    Router,
}

/// Cuts an instance off and connects it again; returns the time that its robots had no estimate
/// from another one, and the time until the shares were even again, s.
fn cut(trial: &mut Trial, seed: u64, from: From, direction: Cut) -> [f64; 2] {
    let mut random = StdRng::seed_from_u64(seed);
    let name = trial.chosen(&mut random);
    let robots = trial.of_instance(name);
    std::thread::sleep(Duration::from_millis(random.random_range(0..2_000)));
    // Up to twice as long as it takes to alert of a robot that sends nothing.
    let lasts = Duration::from_millis(random.random_range(9_000..26_000));
    let lines = trial.cluster.lines(name);
    let line = match from {
        From::Database => lines.database.clone(),
        From::Router => lines.router.clone(),
    };
    let began = now();
    line.cut(direction);
    let took = trial.taken_over(began, name, &robots);
    std::thread::sleep(lasts.saturating_sub(began.elapsed()));
    line.heal();
    let balanced = trial.balanced();
    trial.owners();
    trial.check(seed);
    let alerts = trial.alerts();
    println!(
        "round {seed}: {name} cut off from {from:?}, {direction:?}, for {lasts:.1?}: \
         robots served after {took:.2?} s, even after {balanced:.1?}, alerts {alerts:#?}"
    );
    assert!(balanced < BALANCED_WITHIN, "balanced after {balanced:?}");
    assert!(alerts.is_empty(), "{alerts:?}");
    let slowest = quantile(&took, 1.0);
    assert!(slowest <= SERVED_WITHIN.as_secs_f64(), "{took:?}");
    [slowest, balanced.as_secs_f64()]
}

async fn cuts(kind: &str, from: From, direction: Cut) {
    let mut progress = Progress::of(kind, 1);
    let open = progress.open();
    if !open.is_empty() {
        let parts = Parts {
            in_namespaces: namespaces::may_be_made(),
            ..Trial::parts(true)
        };
        let how = if parts.in_namespaces {
            "packets lost in network namespaces"
        } else {
            "bytes held back by a TCP proxy, because not root"
        };
        println!("{kind}: {how}");
        let cluster = Cluster::watched(&parts).await;
        let mut trial = Trial::on(cluster, &parts, open[0], PAUSE).await;
        trial.alerts();
        for seed in open {
            progress.begin(seed);
            let took = cut(&mut trial, seed, from, direction);
            progress.passed(seed, took.to_vec());
        }
        println!(
            "{kind}: {}; {}",
            trial.seen(),
            progress.told(&trial.server())
        );
    }
    println!(
        "{kind}: robots served by another instance: {}",
        spread(&progress.figures(0))
    );
    println!(
        "  even shares after the end: {}",
        spread(&progress.figures(1))
    );
    println!(
        "  with false alerts, stale rows or documents, later than 9 s or 30 s, or other faults: {}",
        progress.told_failed()
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn from_the_database() {
    cuts("cut_database", From::Database, Cut::Both).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn from_the_database_for_what_it_sends() {
    cuts("cut_to_database", From::Database, Cut::FromInstance).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn from_the_database_for_what_it_is_sent() {
    cuts("cut_of_database", From::Database, Cut::ToInstance).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn from_its_router() {
    cuts("cut_router", From::Router, Cut::Both).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn from_its_router_for_what_it_sends() {
    cuts("cut_to_router", From::Router, Cut::FromInstance).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn from_its_router_for_what_it_is_sent() {
    cuts("cut_of_router", From::Router, Cut::ToInstance).await;
}

/// Makes both lines of an instance slow for a while, as over a bad radio; returns the delay, and
/// the number of decisions acknowledged meanwhile.
fn slow(trial: &mut Trial, seed: u64) -> [f64; 2] {
    let mut random = StdRng::seed_from_u64(seed);
    let name = trial.chosen(&mut random);
    let robots = trial.of_instance(name);
    let delay = Duration::from_millis(random.random_range(50..=DELAY_MAX_MS));
    let begun = records::tenures_begun(&trial.url());
    let before = trial.decider.acknowledged();
    let lines = trial.cluster.lines(name);
    let lines = [lines.database.clone(), lines.router.clone()];
    let all_slow = |delay| lines.iter().for_each(|line| line.delay(delay));
    all_slow(delay);
    std::thread::sleep(SLOW_FOR);
    all_slow(Duration::ZERO);
    let acknowledged = trial.decider.acknowledged() - before;
    let mut kept = trial.of_instance(name);
    kept.retain(|robot| robots.contains(robot));
    trial.check(seed);
    let alerts = trial.alerts();
    println!(
        "round {seed}: lines of {name} {delay:?} slower each way: {acknowledged} decisions \
         acknowledged, kept {} of {} robots, alerts {alerts:#?}",
        kept.len(),
        robots.len()
    );
    assert_eq!(kept.len(), robots.len(), "robots were taken over");
    // Nor did one go and come back meanwhile.
    assert_eq!(records::tenures_begun(&trial.url()), begun);
    assert!(alerts.is_empty(), "{alerts:?}");
    assert!(acknowledged > 0, "nothing was decided");
    [delay.as_secs_f64(), acknowledged as f64]
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn slow_lines_move_no_robot() {
    let mut progress = Progress::of("slow_lines", 1);
    let open = progress.open();
    if !open.is_empty() {
        let mut trial = Trial::start(true, open[0], PAUSE).await;
        trial.alerts();
        for seed in open {
            progress.begin(seed);
            let seen = slow(&mut trial, seed);
            progress.passed(seed, seen.to_vec());
        }
        println!(
            "slow_lines: {}; {}",
            trial.seen(),
            progress.told(&trial.server())
        );
    }
    println!(
        "slow lines, s each way: {}; with robots moved, alerts or stale rows: {}",
        spread(&progress.figures(0)),
        progress.told_failed()
    );
}
