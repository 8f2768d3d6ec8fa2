//! An instance whose machine is gone in the middle of a statement: the server lets its locks go before a
//! lease ends, since whoever takes its robots over needs them.

use std::time::Duration;

use fleetcal_contract::own_server::{Beside, psql};
use fleetcal_store::database_url::PostgresUrl;
use fleetcal_tests::service::{now, wait_for};

use crate::cluster::{Cluster, Parts};
use crate::namespaces;
use crate::network::Cut;

/// Limit that is promised, less than the six seconds of a lease.
const HELD_MAX: Duration = Duration::from_secs(5);
/// Wait below which the locks had been free already.
const HELD_MIN: Duration = Duration::from_secs(1);

/// Measures the wait for the lock of an instance's own row, which every transaction of telemetry
/// holds and which is taken to end its tenures.
fn waited_for_its_row(url: &PostgresUrl) -> Duration {
    let began = now();
    psql(
        url,
        "SET lock_timeout = '60s'; SELECT 1 FROM instance WHERE id = 'a' FOR UPDATE",
    );
    began.elapsed()
}

/// Loses the machine while the server answers a `COPY` that it is ready for the rows. The answer
/// never arrives, so neither the time limit of a statement nor that of an idle transaction runs,
/// and no keepalive is sent while it is in flight: that leaves `tcp_user_timeout`.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_machine_that_is_gone_in_the_middle_of_a_statement_lets_its_locks_go() {
    if !namespaces::may_be_made() {
        println!("not run: a network namespace for the lost machine needs root");
        return;
    }
    let cluster = Cluster::watched(&Parts {
        names: vec!["a"],
        robots: 2,
        parked: 0,
        robots_apply: false,
        fast_takeover: true,
        in_namespaces: true,
    })
    .await;
    let url = cluster.records();
    let _a = cluster.start("a", 0);
    let _robots = cluster.drive();
    wait_for("history", || {
        let rows = psql(&url, "SELECT count(*) > 10 FROM history_second");
        (rows.trim() == "t").then_some(())
    });

    // Its next seconds of history wait for this one's end, with its own row locked.
    let mut beside = Beside::run(&url, "BEGIN; LOCK TABLE history_second IN SHARE MODE");
    wait_for("a copy that waits", || {
        let waiting = "SELECT count(*) > 0 FROM pg_stat_activity WHERE usename = 'a' \
                       AND wait_event_type = 'Lock' AND query LIKE 'COPY history_second%'";
        (psql(&url, waiting).trim() == "t").then_some(())
    });
    cluster.lines("a").database.cut(Cut::Both);
    beside.go_on("COMMIT");
    let held = waited_for_its_row(&url);
    println!("a lost machine held its locks for {held:.1?}");
    assert!(held > HELD_MIN, "{held:?}: it held none");
    assert!(held < HELD_MAX, "{held:?}");
}
