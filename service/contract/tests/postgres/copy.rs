//! A data folder's records, brought into PostgreSQL.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use fleetcal_contract::own_server::psql;
use fleetcal_contract::{
    AddUser, KeepRobot, NOW_S, TestDatabase, clock, config, event, query, record, robot, server,
};
use fleetcal_model::RobotTime;
use fleetcal_sqlite::Source;
use fleetcal_store::Store;
use tokio::sync::Notify;

/// Seconds of history of each of two robots.
const SECONDS: i64 = 5_000;

/// Fills a store with records of people and robots.
async fn fill(store: &Store) {
    store.transact(AddUser("ann")).await.unwrap();
    store.transact(AddUser("eve")).await.unwrap();
    let note = "tab\there, line\nthere, \\N and \\\\x41, Größe";
    let keep = KeepRobot(config(1.2), event(note));
    store.transact(keep).await.unwrap();
    store.save_checkpoint(&robot("a"), RobotTime(7), (0..=255).collect());
    for second in 0..SECONDS {
        record(store, "a", NOW_S + second, 0.1 * second as f64);
        record(store, "b", NOW_S + second, -1e-17);
        if second % 2_000 == 0 {
            store.flush().await.unwrap();
        }
    }
    store.flush().await.unwrap();
}

#[tokio::test]
async fn a_copy_says_the_same_and_goes_on_from_there() {
    let here = TestDatabase::in_sqlite();
    let store = here.open(clock()).await;
    fill(&store).await;
    let span = query("a", NOW_S, NOW_S + SECONDS, 10_000);
    let history = store.history(&span).await.unwrap();
    let events = store.events(&robot("a"), None, 10).await.unwrap();
    store.close().await.unwrap();
    drop(store);

    let there = TestDatabase::on(&server().unwrap()).await;
    let setup = there.postgres().unwrap();
    let copied = AtomicU64::new(0);
    let count = |more| {
        copied.fetch_add(more, Ordering::Relaxed);
    };
    let address = here.address();
    let mut source = Source::open(Path::new(&address)).await.unwrap();
    let contents = fleetcal_postgres::copy(&mut source, setup.clone(), &count)
        .await
        .unwrap();
    let rows: u64 = contents.iter().map(|(_, content)| content.rows).sum();
    assert_eq!(copied.load(Ordering::Relaxed), rows);
    let of = |table| contents.iter().find(|(name, _)| *name == table).unwrap();
    assert_eq!(of("history_second").1.rows, 2 * SECONDS as u64);
    assert_eq!(of("\"user\"").1.rows, 2);

    let refused = fleetcal_postgres::copy(&mut source, setup.clone(), &count)
        .await
        .unwrap_err()
        .to_string();
    assert!(
        refused.contains("is not empty: got 2 rows in robot"),
        "{refused}"
    );

    let store = there.open(clock()).await;
    assert_eq!(store.history(&span).await.unwrap(), history);
    let kept = store.events(&robot("a"), None, 10).await.unwrap();
    // The new one is the start of the service.
    assert_eq!(kept[1..], events);
    let next = store.transact(AddUser("bob")).await.unwrap();
    assert_eq!(next.0, 3, "numbers go on");
    let checkpoints = store.load_checkpoints().await.unwrap();
    assert_eq!(checkpoints[0].state, (0..=255).collect::<Vec<u8>>());
}

#[tokio::test]
async fn a_copy_that_is_broken_off_leaves_nothing_and_can_be_run_again() {
    let here = TestDatabase::in_sqlite();
    let store = here.open(clock()).await;
    fill(&store).await;
    store.close().await.unwrap();
    drop(store);
    let there = TestDatabase::on(&server().unwrap()).await;
    let setup = there.postgres().unwrap();
    let address = here.address();
    let mut source = Source::open(Path::new(&address)).await.unwrap();
    let (copied, half) = (AtomicU64::new(0), Notify::new());
    let count = |more| {
        if copied.fetch_add(more, Ordering::Relaxed) + more > SECONDS as u64 {
            half.notify_one();
        }
    };
    tokio::select! {
        ended = fleetcal_postgres::copy(&mut source, setup.clone(), &count) => {
            panic!("it ended before it was broken off: {ended:?}");
        }
        () = half.notified() => {}
    }
    let seconds = "SELECT count(*) FROM history_second";
    assert_eq!(psql(&setup.url, seconds).trim(), "0");
    drop(source);
    let mut source = Source::open(Path::new(&address)).await.unwrap();
    let again = fleetcal_postgres::copy(&mut source, setup.clone(), &|_| {}).await;
    again.unwrap();
    let all = (2 * SECONDS).to_string();
    assert_eq!(psql(&setup.url, seconds).trim(), all);
}
