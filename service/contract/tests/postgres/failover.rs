//! Several servers, of which one can be written.

use std::time::Duration;

use async_trait::async_trait;
use fleetcal_contract::{NOW_S, NS, clock, config, query, record, robot};
use fleetcal_model::{Version, WallTime};
use fleetcal_postgres::open;
use fleetcal_store::{Job, Records, Store, StoreError};
use tokio::net::TcpListener;
use tokio::time::Instant;

use crate::decision::{Decide, times_decided};
use fleetcal_contract::own_server::{OwnServer, psql, setup, url_of};

/// Time within which the store works again after another server is writable.
const AGAIN_WITHIN: Duration = Duration::from_secs(5);

/// Time within which a decision is refused while no server is writable.
const REFUSED_WITHIN: Duration = Duration::from_secs(3);

/// Job that adds a robot.
#[derive(Debug)]
struct AddRobot(&'static str);

#[async_trait]
impl Job for AddRobot {
    type Done = ();

    async fn run(&self, records: &mut dyn Records) -> Result<(), StoreError> {
        let now = WallTime(NOW_S * NS);
        let id = robot(self.0);
        records
            .save_config(&id, &config(1.0), None, Version(1), now)
            .await
    }
}

/// Waits until a job succeeds; returns the time it took.
async fn decided_again(store: &Store, decision: &Decide) -> Duration {
    let began = Instant::now();
    while let Err(error) = store.transact(decision.clone()).await {
        assert!(began.elapsed() < 2 * AGAIN_WITHIN, "{error:?}");
    }
    began.elapsed()
}

/// Waits until the queued telemetry is written.
async fn flushed(store: &Store) {
    let began = Instant::now();
    while let Err(error) = store.flush().await {
        assert!(began.elapsed() < 2 * AGAIN_WITHIN, "{error:?}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_writable_server_is_found_again_after_a_failover() {
    let primary = OwnServer::start_new("trust");
    let standby = OwnServer::standby_of(&primary);
    // They take connections and never say anything, as behind a firewall.
    let mut silent = Vec::new();
    for _ in 0..3 {
        silent.push(TcpListener::bind("127.0.0.1:0").await.unwrap());
    }
    let mut hosts: Vec<String> = silent
        .iter()
        .map(|silent| silent.local_addr().unwrap().to_string())
        .collect();
    hosts.extend([standby.host(), primary.host()]);
    let hosts: Vec<&str> = hosts.iter().map(String::as_str).collect();
    let url = url_of(&hosts, "fleetcal", "postgres");
    let store = open(setup(&url), Box::new(()), clock() as _).await.unwrap();
    let before = Decide("before".to_owned());
    store.transact(before.clone()).await.unwrap();
    record(&store, "a", NOW_S, 0.1);
    store.flush().await.unwrap();
    standby.wait_until_equal(&primary);

    primary.stop();
    let began = Instant::now();
    let refused = store.transact(Decide("while away".to_owned())).await;
    let took = began.elapsed();
    println!("{refused:?} after {took:?}");
    assert!(took < REFUSED_WITHIN, "{took:?}");
    let told = refused.unwrap_err().to_string();
    assert!(
        told.contains("is a standby, which cannot be written"),
        "{told}"
    );
    standby.promote();
    let after = Decide("after".to_owned());
    let took = decided_again(&store, &after).await;
    assert!(took < AGAIN_WITHIN, "{took:?}");
    println!("{took:?} until the new primary was written");
    record(&store, "a", NOW_S + 1, 0.2);
    flushed(&store).await;
    let seconds = store
        .history(&query("a", NOW_S, NOW_S + 2, 2))
        .await
        .unwrap();
    assert_eq!(seconds.stretches.len(), 2);
    assert_eq!(times_decided(&store, &[before, after]).await, [1, 1]);
    store.close().await.unwrap();
}

/// Fails over to a standby that lagged and assigns the same numbers again: the store has to forget
/// the keys of the lost rows.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn rows_that_a_failover_has_lost_are_not_taken_for_others() {
    let primary = OwnServer::start_new("trust");
    let url = primary.url("postgres");
    fleetcal_postgres::migrate(setup(&url), None).await.unwrap();
    let standby = OwnServer::standby_of(&primary);
    standby.stop();
    let hosts = [primary.host(), standby.host()];
    let url = url_of(&[&hosts[0], &hosts[1]], "fleetcal", "postgres");
    let store = open(setup(&url), Box::new(()), clock() as _).await.unwrap();
    record(&store, "lost", NOW_S, 0.1);
    store.flush().await.unwrap();

    primary.stop();
    standby.start();
    standby.promote();
    decided_again(&store, &Decide("the first after it".to_owned())).await;
    store.transact(AddRobot("other")).await.unwrap();
    record(&store, "lost", NOW_S + 1, 0.2);
    flushed(&store).await;
    for (name, count) in [("lost", 1), ("other", 0), ("a", 0)] {
        let seconds = store
            .history(&query(name, NOW_S, NOW_S + 2, 2))
            .await
            .unwrap();
        assert_eq!(seconds.stretches.len(), count, "{name}");
    }
    store.close().await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_acknowledged_is_known_to_be_on_a_second_machine_or_not() {
    let primary = OwnServer::start_new("trust");
    let url = primary.url("postgres");
    let store = open(setup(&url), Box::new(()), clock() as _).await.unwrap();
    let survives = async || store.survives_machine_loss().await.unwrap();
    assert_eq!(survives().await, Some(false));
    let standby = OwnServer::standby_of(&primary);
    // It is behind as it likes.
    assert_eq!(survives().await, Some(false));
    psql(&url, "ALTER SYSTEM SET synchronous_standby_names = '*'");
    psql(&url, "SELECT pg_reload_conf()");
    let began = Instant::now();
    while survives().await != Some(true) {
        assert!(began.elapsed() < 2 * AGAIN_WITHIN);
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    store.transact(Decide("on two".to_owned())).await.unwrap();
    standby.stop();
    let began = Instant::now();
    // A commit waits for the next one now.
    while survives().await.is_some() {
        assert!(began.elapsed() < 2 * AGAIN_WITHIN);
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    psql(&url, "ALTER SYSTEM RESET synchronous_standby_names");
    psql(&url, "SELECT pg_reload_conf()");
    store.close().await.unwrap();
}
