//! A connection that is cut exactly at COMMIT.

use std::time::Duration;

use fleetcal_contract::{NOW_S, clock, query, record};
use fleetcal_postgres::open;
use fleetcal_store::StoreError;
use fleetcal_store::database_url::PostgresUrl;
use tokio::time::Instant;

use crate::decision::{Decide, times_decided};
use crate::proxy::{Cut, Proxy};
use fleetcal_contract::own_server::{named, number, psql, setup};

/// Time within which the store writes again after a cut.
const AGAIN_WITHIN: Duration = Duration::from_secs(5);

/// Makes a database behind a proxy.
async fn behind_proxy() -> (Proxy, PostgresUrl) {
    let direct = fleetcal_postgres::create_for_test(&named()).await.unwrap();
    Proxy::before_database(&direct).await
}

/// Loses a connection without the server's notice, which still has the lock of the database.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_service_goes_on_when_its_server_has_not_noticed_a_loss() {
    let (proxy, url) = behind_proxy().await;
    let store = open(setup(&url), Box::new(()), clock() as _).await.unwrap();
    for round in 0..5 {
        record(&store, "b", NOW_S + round, 0.5);
        store.flush().await.unwrap();
        proxy.lose_clients();
        let lost = Instant::now();
        record(&store, "b", NOW_S + 100 + round, 0.5);
        while let Err(error) = store.flush().await {
            assert!(lost.elapsed() < AGAIN_WITHIN, "{error:?}");
        }
        assert!(lost.elapsed() < AGAIN_WITHIN, "{:?}", lost.elapsed());
    }
    let all = query("b", NOW_S, NOW_S + 200, 600);
    assert_eq!(store.history(&all).await.unwrap().stretches.len(), 10);
    store.close().await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_commit_whose_answer_is_lost_is_told_and_counts_once_or_not_at_all() {
    let cuts = number("CONTRACT_CUTS", 40);
    let (proxy, url) = behind_proxy().await;
    let store = open(setup(&url), Box::new(()), clock() as _).await.unwrap();
    let mut slowest = Duration::ZERO;
    for round in 0..cuts {
        let cut = if round % 2 == 0 {
            Cut::BeforeCommit
        } else {
            Cut::AfterCommit
        };
        let decision = Decide(format!("cut {round}"));
        proxy.cut_next(cut);
        let told = store.transact(decision.clone()).await;
        let told = told.map(|id| format!("{id}"));
        assert!(matches!(told, Err(StoreError::Commit(_))), "{told:?}");
        assert!(!proxy.is_armed());
        let began = Instant::now();
        let kept = usize::from(cut == Cut::AfterCommit);
        let times = times_decided(&store, std::slice::from_ref(&decision)).await;
        assert_eq!(times, [kept], "{decision:?}");
        let first = store.transact(decision.clone()).await.unwrap();
        let again = store.transact(decision.clone()).await.unwrap();
        assert_eq!(first, again);
        slowest = slowest.max(began.elapsed());
        let times = times_decided(&store, &[decision]).await;
        assert_eq!(times, [1]);
    }
    assert!(slowest < AGAIN_WITHIN, "{slowest:?}");
    println!("{cuts} cuts; the slowest retry took {slowest:?}");
    store.close().await.unwrap();
}

/// Ends the connection of jobs, that of telemetry, and those for reading, each while it is idle.
fn end_idle_connections(url: &PostgresUrl) {
    let sql = "SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity
        WHERE datname = current_database() AND pid <> pg_backend_pid() AND state = 'idle'";
    let began = Instant::now();
    let mut ended = 0;
    while ended < 3 {
        ended += psql(url, sql).trim().parse::<usize>().unwrap();
        assert!(began.elapsed() < AGAIN_WITHIN, "{ended} connections ended");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_connection_that_was_lost_while_nobody_used_it_costs_nothing() {
    let url = fleetcal_postgres::create_for_test(&named()).await.unwrap();
    let store = open(setup(&url), Box::new(()), clock() as _).await.unwrap();
    for round in 0..10 {
        let decision = Decide(format!("round {round}"));
        store.transact(decision.clone()).await.unwrap();
        assert_eq!(times_decided(&store, &[decision]).await, [1]);
        end_idle_connections(&url);
        record(&store, "b", NOW_S + round, 0.5);
        store.flush().await.unwrap();
    }
    let seconds = store
        .history(&query("b", NOW_S, NOW_S + 10, 60))
        .await
        .unwrap();
    assert_eq!(seconds.stretches.len(), 10);
    assert_eq!(store.counters().failed_commits, 0);
    store.close().await.unwrap();
}
