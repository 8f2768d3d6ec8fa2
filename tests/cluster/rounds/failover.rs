//! A PostgreSQL under Patroni whose primary is moved, killed or frozen, or whose etcd is gone, while
//! somebody decides.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use fleetcal_tests::service::{now, wait_for};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

use crate::cluster::{Cluster, Parts};
use crate::figures::{quantile, spread, told};
use crate::patroni::Patroni;
use crate::progress::Progress;
use crate::trial::{DECIDERS, DECIDERS_PAUSE, DRIVING, Trial, assert_rate};
use crate::twin::{self, Twin};

/// Time after the appearance of a primary within which decisions are taken again, s.
const AGAIN_WITHIN_S: f64 = 5.0;
const ETCD_GONE_FOR: Duration = Duration::from_mins(1);

/// Failure of the servers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Failure {
    SwitchedOver,
    PrimaryKilled,
    PrimaryFrozen,
    PostmasterKilled,
    EtcdGone,
}

impl Failure {
    const ALL: [Self; 5] = [
        Self::SwitchedOver,
        Self::PrimaryKilled,
        Self::PrimaryFrozen,
        Self::PostmasterKilled,
        Self::EtcdGone,
    ];

    /// Returns the name of its rounds.
    const fn kind(self) -> &'static str {
        match self {
            Self::SwitchedOver => "switchover",
            Self::PrimaryKilled => "primary_killed",
            Self::PrimaryFrozen => "primary_frozen",
            Self::PostmasterKilled => "postmaster_of_patroni",
            Self::EtcdGone => "etcd_gone",
        }
    }

    /// Causes the failure, and repairs everything; returns the time since which there is a primary
    /// again.
    fn happen(self, patroni: &mut Patroni, random: &mut StdRng) -> Instant {
        let former = patroni.primary_name();
        match self {
            Self::SwitchedOver => {
                patroni.switch_over();
                patroni.next_primary(former)
            }
            Self::PrimaryKilled => {
                patroni.kill(former);
                let since = patroni.next_primary(former);
                std::thread::sleep(Duration::from_millis(random.random_range(0..4_000)));
                patroni.start_again(former);
                since
            }
            Self::PrimaryFrozen => {
                patroni.freeze(former);
                let since = patroni.next_primary(former);
                std::thread::sleep(Duration::from_millis(random.random_range(0..4_000)));
                patroni.thaw(former);
                since
            }
            Self::PostmasterKilled => {
                patroni.kill_postmaster(former);
                patroni.any_primary()
            }
            Self::EtcdGone => {
                patroni.kill_etcd();
                std::thread::sleep(ETCD_GONE_FOR);
                patroni.start_etcd();
                patroni.any_primary()
            }
        }
    }
}

async fn trial(program: PathBuf, seed: u64) -> (Trial, Twin) {
    let parts = Parts {
        names: vec!["a", "b"],
        robots: DRIVING,
        parked: DECIDERS,
        robots_apply: false,
        fast_takeover: true,
        in_namespaces: false,
    };
    let cluster = Cluster::under_patroni(Patroni::start(&program), &parts);
    let twin = Twin::start(&cluster);
    (Trial::on(cluster, &parts, seed, DECIDERS_PAUSE).await, twin)
}

/// Returns the path of a `patroni`.
pub fn program() -> PathBuf {
    let path = std::env::var_os("FLEETCAL_PATRONI");
    let path = path.expect("FLEETCAL_PATRONI names a patroni: make cluster-failover");
    path.into()
}

/// Causes one failure; returns the time without decisions after there was a primary, the longest
/// time without a decision, s, the number of acknowledged decisions, and their rate before.
fn fail(trial: &mut Trial, failure: Failure, seed: u64) -> [f64; 4] {
    let mut random = StdRng::seed_from_u64(seed);
    let rate = trial.decisions_per_s(Duration::from_millis(random.random_range(3_000..6_000)));
    assert_rate(rate);
    let (began, before) = (now(), trial.decider.acknowledged());
    let patroni = trial.cluster.patroni.as_mut().unwrap();
    let primary = failure.happen(patroni, &mut random);
    let decided = wait_for("a decision", || trial.decider.acknowledged_since(primary));
    let again = decided - primary;
    trial.cluster.patroni.as_ref().unwrap().wait_until_whole();
    trial.balanced();
    trial.owners();
    let pause = trial.decider.longest_pause(began);
    let count = trial.decider.acknowledged() - before;
    trial.check(seed);
    println!(
        "round {seed}, {failure:?}: {count} decisions acknowledged, none for {pause:.2?}, the next one \
         {again:.2?} after there was a primary; {rate:.0} a second before"
    );
    [again.as_secs_f64(), pause.as_secs_f64(), count as f64, rate]
}

fn tell(failure: Failure, progress: &Progress) {
    let again = progress.figures(0);
    println!(
        "{failure:?}: decisions again after there is a primary: {}",
        spread(&again)
    );
    println!(
        "  longest time without a decision: {}",
        spread(&progress.figures(1))
    );
    println!(
        "  with a lost decision, a stale row or other faults: {}",
        progress.told_failed()
    );
    println!(
        "  decisions lost in rounds that passed: {}",
        told(0, progress.count(2))
    );
    assert!(quantile(&again, 1.0) <= AGAIN_WITHIN_S, "{again:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn failovers_lose_nothing_acknowledged() {
    let rounds = |failure: Failure| (failure, Progress::of(failure.kind(), 1));
    let mut all = Failure::ALL.map(rounds);
    let open: Vec<_> = all
        .iter()
        .flat_map(|(_, progress)| progress.open())
        .collect();
    if let Some(&first) = open.first() {
        let (mut trial, twin) = trial(program(), first).await;
        for (failure, progress) in &mut all {
            for seed in progress.open() {
                progress.begin(seed);
                let figures = fail(&mut trial, *failure, seed);
                progress.passed(seed, figures.to_vec());
            }
        }
        let (seen, server) = (trial.seen(), trial.server());
        let versions = trial.cluster.patroni.as_ref().unwrap().versions();
        println!("failovers: {seen}; {}; {versions}", all[0].1.told(&server));
        let cluster = trial.end();
        let (states, of_twin) = (twin::states(&cluster), twin.end().await);
        let is_equal = |robot: &&String| states.get(*robot) == of_twin.get(*robot);
        let equal = of_twin.keys().filter(is_equal).count();
        println!(
            "  states equal to those of an undisturbed twin, to the bit: {equal} of {DRIVING}"
        );
        assert_eq!(equal, DRIVING);
    }
    for (failure, progress) in &all {
        tell(*failure, progress);
    }
}
