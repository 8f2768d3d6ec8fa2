//! A primary that is frozen between two steps of its Patroni, which has read that it leads and is about to
//! renew its lock, and goes on when another server has been the primary for a while.
//!
//! Before version 3.1 Patroni wrote the key of the leader without a comparison: such a server takes
//! its lock back, and what was acknowledged meanwhile is lost with the timeline of the other one.

use std::path::Path;
use std::time::Duration;

use fleetcal_tests::service::wait_for;

use super::failover::program;
use crate::checker::Violation;
use crate::cluster::{Cluster, Parts};
use crate::patroni::Patroni;
use crate::trial::{DRIVING, PARKED, Trial};

const PAUSE: Duration = Duration::from_millis(50);
/// Time for which the other server is the primary before the frozen one is resumed.
const LASTS_ON: Duration = Duration::from_secs(3);
const DEMOTED_WITHIN: Duration = Duration::from_secs(10);
/// Most attempts, because Patroni queries its server for other reasons as well, and then reads the
/// leader again.
const TRIES_MAX: usize = 3;

/// Returns the violations after a primary was frozen so, after at most `tries` attempts.
async fn violations(program: &Path, tries: usize) -> Vec<Violation> {
    let parts = Parts {
        names: vec!["a", "b"],
        robots: DRIVING,
        parked: PARKED,
        robots_apply: false,
        fast_takeover: true,
        in_namespaces: false,
    };
    let cluster = Cluster::under_patroni(Patroni::start(program), &parts);
    let trial = Trial::on(cluster, &parts, 7, PAUSE).await;
    let patroni = trial.cluster.patroni.as_ref().unwrap();
    let mut found = Vec::new();
    for _ in 0..tries {
        patroni.wait_until_whole();
        let before = trial.decider.acknowledged();
        let thawed = patroni.freeze_before_renewal(LASTS_ON);
        wait_for("a decision", || trial.decider.acknowledged_since(thawed));
        // One that has lost its lock can be read as the primary until its Patroni has seen it.
        std::thread::sleep(DEMOTED_WITHIN);
        // Servers of whom two had the lock may never be whole again.
        found = wait_for("a whole cluster, or what is wrong", || {
            let found = trial.evidence().violations();
            (!found.is_empty() || patroni.is_whole()).then_some(found)
        });
        let decided = trial.decider.acknowledged() - before;
        println!(
            "{}: {decided} decisions acknowledged, {} violations",
            patroni.versions(),
            found.len()
        );
        if !found.is_empty() {
            break;
        }
    }
    found
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_old_patroni_that_takes_its_lock_back_is_found() {
    let old = std::env::var_os("FLEETCAL_OLD_PATRONI");
    let old = old.expect("FLEETCAL_OLD_PATRONI names a patroni 3.0.2: make cluster-failover");
    assert_eq!(violations(&program(), 2).await, []);
    let found = violations(old.as_ref(), TRIES_MAX).await;
    let is_lost = |one: &&Violation| matches!(one, Violation::Lost { .. });
    let lost = found.iter().filter(is_lost).count();
    println!("with the old Patroni: {lost} acknowledged decisions lost");
    assert!(lost > 0, "{found:?}");
}
