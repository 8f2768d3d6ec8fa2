//! A primary that is frozen in the midst of a request to etcd, and goes on when another server has been
//! the primary for a while.
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
/// The other server is the primary for so long before the frozen one goes on.
const LASTS_ON: Duration = Duration::from_secs(3);
/// A request that is not the first of Patroni's cycle finds it with newer eyes.
const TRIES_MAX: usize = 4;

/// What is wrong after a primary was frozen so, at most `tries` times until something is.
async fn violations(program: &Path, tries: usize) -> Vec<Violation> {
    let parts = Parts {
        names: vec!["a", "b"],
        robots: DRIVING,
        parked: PARKED,
        fast_takeover: true,
        in_namespaces: false,
    };
    let cluster = Cluster::under_patroni(Patroni::start(program).await, &parts);
    let trial = Trial::on(cluster, &parts, 7, PAUSE).await;
    let patroni = trial.cluster.patroni.as_ref().unwrap();
    let mut found = Vec::new();
    for _ in 0..tries {
        patroni.wait_until_whole();
        let before = trial.decider.acknowledged();
        let thawed = patroni.freeze_in_a_request(LASTS_ON);
        wait_for("a decision", || trial.decider.acknowledged_since(thawed));
        patroni.wait_until_whole();
        let decided = trial.decider.acknowledged() - before;
        found = trial.evidence().violations();
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
