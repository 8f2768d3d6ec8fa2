//! Instances that are killed, frozen, or stopped in order.

use std::time::Duration;

use fleetcal_contract::own_server::number;
use fleetcal_tests::service::now;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

use crate::cluster::Cluster;
use crate::figures::{quantile, spread, told};
use crate::progress::Progress;
use crate::trial::{BALANCED_WITHIN, DRIVING, HANDED_OVER_WITHIN, SERVED_WITHIN, Trial};
use crate::twin::{self, Twin};

/// Pause between two decisions of the decider beside it.
const PAUSE: Duration = Duration::from_millis(200);
/// Time limits of a takeover, s: for half of them, and for 99 of 100.
const TAKEOVER_S: [f64; 2] = [1.5, 3.0];

/// Kills an instance; returns the time that each of its robots had no estimate from another one, s.
fn kill(trial: &mut Trial, seed: u64) -> Vec<f64> {
    let mut random = StdRng::seed_from_u64(seed);
    let name = trial.chosen(&mut random);
    let robots = trial.of_instance(name);
    std::thread::sleep(Duration::from_millis(random.random_range(0..2_000)));
    let killed = trial.kill(name);
    let took = trial.taken_over(killed, name, &robots);
    trial.start_again(name);
    let balanced = trial.balanced();
    assert!(balanced < BALANCED_WITHIN, "balanced after {balanced:?}");
    trial.check(seed);
    println!("round {seed}: {name} killed, its robots served after {took:.2?} s");
    took
}

async fn takeovers(kind: &str, fast_takeover: bool, rounds: usize) -> Progress {
    let mut progress = Progress::of(kind, rounds);
    let open = progress.open();
    if open.is_empty() {
        return progress;
    }
    let mut trial = Trial::start(fast_takeover, open[0], PAUSE).await;
    for seed in open {
        progress.begin(seed);
        let took = kill(&mut trial, seed);
        progress.passed(seed, vec![quantile(&took, 1.0)]);
    }
    assert!(trial.drives());
    println!(
        "{kind}: {}; {}",
        trial.seen(),
        progress.told(&trial.server())
    );
    progress
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_killed_instance_is_replaced() {
    let progress = takeovers("takeover", true, 5).await;
    let slowest = progress.figures(0);
    let late = slowest
        .iter()
        .filter(|took| **took > SERVED_WITHIN.as_secs_f64());
    let late = told(late.count() as u64, progress.len());
    println!(
        "takeover after kill -9, slowest robot of each: {}",
        spread(&slowest)
    );
    println!("  after more than 9 s: {late}");
    println!("  failed or broken off: {}", progress.told_failed());
    let bounds = [quantile(&slowest, 0.5), quantile(&slowest, 0.99)];
    assert!(
        bounds[0] <= TAKEOVER_S[0] && bounds[1] <= TAKEOVER_S[1],
        "{bounds:?}"
    );
    assert!(quantile(&slowest, 1.0) <= SERVED_WITHIN.as_secs_f64());
}

/// Kills instances whose liveliness tokens and advisory locks are ignored: the lease has to end.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_killed_instance_is_replaced_when_its_lease_has_ended() {
    let progress = takeovers("takeover_by_lease", false, 3).await;
    let slowest = progress.figures(0);
    let late = slowest
        .iter()
        .filter(|took| **took > SERVED_WITHIN.as_secs_f64());
    let late = told(late.count() as u64, progress.len());
    println!("takeover without fast_takeover: {}", spread(&slowest));
    println!("  after more than 9 s: {late}");
    println!("  failed or broken off: {}", progress.told_failed());
    assert!(quantile(&slowest, 1.0) <= SERVED_WITHIN.as_secs_f64());
}

/// Time that robots drive (or `CLUSTER_DRIVEN_S`) before their instance is killed, and then until
/// they are compared with a twin's, s.
const DRIVEN_BEFORE_S: usize = 40;
const COMPARED_AFTER: Duration = Duration::from_mins(1);
/// Largest relative excess of a sigma over that of an undisturbed twin.
const LESS_CERTAIN: f64 = 0.05;

/// Excess of a sigma of a robot after a takeover over the twin's.
#[derive(Debug)]
struct CertaintyLost {
    robot: String,
    parameter: &'static str,
    /// Excess as a share of the twin's.
    share: f64,
}

/// Kills an instance and compares the sigmas of its robots with the twin's.
fn certainty_lost(trial: &mut Trial, twin: &Twin, seed: u64) -> Vec<CertaintyLost> {
    let name = trial.chosen(&mut StdRng::seed_from_u64(seed));
    let robots = trial.of_instance(name);
    let killed = trial.kill(name);
    trial.taken_over(killed, name, &robots);
    std::thread::sleep(COMPARED_AFTER.saturating_sub(killed.elapsed()));
    let another = trial.instances.values().next().unwrap();
    let (taken_over, undisturbed) = (
        twin::sigmas(&robots, |path| another.get(path)),
        twin.sigmas(&robots),
    );
    trial.check(seed);
    let of_robot = |(robot, sigmas): (&String, &Vec<f64>)| {
        let pairs = sigmas.iter().zip(&undisturbed[robot]);
        let lost = twin::CALIBRATED.iter().zip(pairs);
        let lost = lost.map(|(parameter, (sigma, of_twin))| CertaintyLost {
            robot: robot.clone(),
            parameter: parameter.name(),
            share: sigma / of_twin - 1.0,
        });
        lost.collect::<Vec<_>>()
    };
    taken_over.iter().flat_map(of_robot).collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn sigmas_after_a_takeover_are_nearly_those_of_a_twin() {
    let mut progress = Progress::of("certainty", 1);
    for seed in progress.open() {
        progress.begin(seed);
        let parts = Trial::parts(true);
        let cluster = Cluster::watched(&parts).await;
        let twin = Twin::start(&cluster);
        let mut trial = Trial::on(cluster, &parts, seed, PAUSE).await;
        let driven_s = number("CLUSTER_DRIVEN_S", DRIVEN_BEFORE_S);
        std::thread::sleep(Duration::from_secs(driven_s as u64));
        let lost = certainty_lost(&mut trial, &twin, seed);
        assert!(!lost.is_empty() && trial.drives(), "nothing was compared");
        println!("round {seed}: sigmas of robots taken over, above a twin's after 60 s:");
        for CertaintyLost {
            robot,
            parameter,
            share,
        } in &lost
        {
            println!("  {robot} {parameter}: {:+.2} %", share * 100.0);
        }
        let shares: Vec<_> = lost.iter().map(|one| one.share).collect();
        assert!(shares.iter().all(|share| share.is_finite()), "{lost:?}");
        progress.passed(seed, vec![quantile(&shares, 1.0)]);
    }
    let most = progress.figures(0);
    let wider = most.iter().filter(|lost| **lost > LESS_CERTAIN).count();
    println!(
        "rounds with a sigma more than 5 % above an undisturbed twin's 60 s after a takeover: {wider} of {}; at most \
         {:+.2} %",
        progress.len(),
        quantile(&most, 1.0) * 100.0
    );
    println!("  failed or broken off: {}", progress.told_failed());
    assert_eq!(wider, 0, "{most:?}");
}

/// Freezes an instance for some time; returns the number of late estimates so far.
fn freeze(trial: &Trial, seed: u64) -> usize {
    let mut random = StdRng::seed_from_u64(seed);
    let name = trial.chosen(&mut random);
    let robots = trial.of_instance(name);
    std::thread::sleep(Duration::from_millis(random.random_range(0..2_000)));
    let frozen_for = Duration::from_millis(random.random_range(500..20_000));
    let instance = &trial.instances[name];
    let frozen = now();
    instance.process.signal("STOP");
    std::thread::sleep(frozen_for);
    // One that is frozen for less may have kept its robots.
    let took = trial.watch.taken_over(frozen, name, &robots);
    instance.process.signal("CONT");
    let thawed = now();
    if frozen_for > SERVED_WITHIN {
        let took = took.expect("other instances' estimates of all its robots");
        assert!(took.iter().all(|took| *took <= SERVED_WITHIN), "{took:?}");
    }
    let balanced = trial.balanced();
    assert!(balanced < BALANCED_WITHIN, "balanced after {balanced:?}");
    trial.owners();
    let late = trial.check(seed);
    println!(
        "round {seed}: {name} frozen for {frozen_for:.1?}, in order after {:.1?}",
        thawed.elapsed()
    );
    late
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_frozen_instance_does_no_harm_when_it_thaws() {
    let mut progress = Progress::of("freeze", 5);
    let open = progress.open();
    if !open.is_empty() {
        let trial = Trial::start(true, open[0], PAUSE).await;
        let mut late = 0;
        for seed in open {
            progress.begin(seed);
            let late_now = freeze(&trial, seed);
            progress.passed(seed, vec![(late_now - late) as f64]);
            late = late_now;
        }
        println!(
            "freeze: {}; {}",
            trial.seen(),
            progress.told(&trial.server())
        );
    }
    println!(
        "freezes of 0.5 to 20 s, with stale rows or documents, more than one late estimate of a robot, or other \
         faults: {}",
        progress.told_failed()
    );
    println!(
        "  one late estimate, which is permitted: {} times",
        progress.count(0)
    );
}

/// Stops an instance in order and starts it again; returns the longest times without an estimate,
/// s.
fn stop_and_join(trial: &mut Trial, seed: u64) -> [f64; 2] {
    let mut random = StdRng::seed_from_u64(seed);
    let name = trial.chosen(&mut random);
    let longest = |gaps: std::collections::BTreeMap<String, Duration>| {
        assert_eq!(gaps.len(), DRIVING);
        gaps.into_values().max().unwrap()
    };
    let stopped = now();
    let mut leaving = trial.instances.remove(name).unwrap();
    leaving.process.end_in_order();
    let took = stopped.elapsed();
    trial.owners();
    let end = longest(trial.watch.gaps(stopped));
    let joined = now();
    trial.start_again(name);
    let balanced = trial.balanced();
    assert!(balanced < BALANCED_WITHIN, "balanced after {balanced:?}");
    trial.owners();
    let join = longest(trial.watch.gaps(joined));
    trial.check(seed);
    println!("round {seed}: {name} left in {took:.1?}, longest gaps {end:?}, {join:?}");
    [end.as_secs_f64(), join.as_secs_f64()]
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_ends_or_joins_in_order_breaks_no_stream() {
    let mut progress = Progress::of("planned", 2);
    let open = progress.open();
    if !open.is_empty() {
        let mut trial = Trial::start(true, open[0], PAUSE).await;
        for seed in open {
            progress.begin(seed);
            let gaps = stop_and_join(&mut trial, seed);
            progress.passed(seed, gaps.to_vec());
        }
        println!(
            "planned: {}; {}",
            trial.seen(),
            progress.told(&trial.server())
        );
    }
    let (ends, joins) = (progress.figures(0), progress.figures(1));
    println!(
        "longest time without an estimate at a planned end: {}",
        spread(&ends)
    );
    println!("  and when an instance joins: {}", spread(&joins));
    let all = [ends, joins].concat();
    let within = HANDED_OVER_WITHIN.as_secs_f64();
    let late = all.iter().filter(|gap| **gap > within).count();
    println!(
        "  longer than 2.2 s: {}",
        told(late as u64, all.len() as u64)
    );
    println!("  failed or broken off: {}", progress.told_failed());
    assert_eq!(late, 0, "{all:?}");
}
