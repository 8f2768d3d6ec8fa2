//! Durability through kills, locks, overload and versions.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::Duration;

use fleetcal_domain::limits;
use fleetcal_store::StoreError;
use sqlx::{ConnectOptions, Connection};

use super::*;
use fleetcal_contract::AddUser;

/// Variable with the child process's folder.
const FOLDER: &str = "FLEETCAL_TEST_STORE";
/// Name of the child's test.
const CHILD: &str = "tests::durability::child_that_is_killed";

pub(super) async fn raw(folder: &Path) -> sqlx::SqliteConnection {
    let database = folder.join("fleetcal.db");
    sqlx::sqlite::SqliteConnectOptions::new()
        .filename(database)
        .connect()
        .await
        .unwrap()
}

/// Writes a second of history again and again and prints each committed one, until it is killed by
/// its parent.
#[tokio::test]
#[ignore = "is the child of a_killed_store_has_every_committed_second"]
async fn child_that_is_killed() {
    let folder = std::env::var(FOLDER).unwrap();
    let store = open(Path::new(&folder), &clock()).await;
    let first = store
        .last_second(&robot("a"))
        .await
        .unwrap()
        .map_or(NOW_S, |last| last + 1_000);
    for second in first..first + 1_000_000 {
        record(&store, "a", second, 0.5);
        store.flush().await.unwrap();
        println!("committed {second}");
    }
}

#[tokio::test]
async fn nothing_is_acknowledged_once_the_database_was_moved_or_replaced() {
    for (name, is_replaced) in [
        ("fleetcal.db", false),
        ("fleetcal.db", true),
        ("fleetcal.db-wal", false),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let store = open(folder.path(), &clock()).await;
        store.transact(AddUser("ann")).await.unwrap();
        let file = folder.path().join(name);
        let away = folder.path().join("away");
        std::fs::rename(&file, &away).unwrap();
        if is_replaced {
            std::fs::copy(&away, &file).unwrap();
        }
        let refused = store.transact(AddUser("bo")).await.unwrap_err();
        let said = format!("{refused:?}");
        assert!(said.contains("was moved, removed or replaced"), "{said}");
        assert!(store.probe().await.is_err(), "readiness says it as well");
        // Back in its place, it is written again, unless a reader has opened the other one and
        // ended the log.
        if !is_replaced {
            std::fs::rename(&away, &file).unwrap();
            store.transact(AddUser("cy")).await.unwrap();
        }
    }
}

#[tokio::test]
async fn a_killed_store_has_every_committed_second() {
    let folder = tempfile::tempdir().unwrap();
    let mut committed = Vec::new();
    for kill_after in [1, 5, 17, 60] {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", CHILD, "--ignored", "--nocapture"])
            .env(FOLDER, folder.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let mut told = 0;
        while told < kill_after {
            let line = lines.next().expect("the child ended by itself").unwrap();
            if let Some((_, second)) = line.split_once("committed ") {
                committed.push(second.parse::<i64>().unwrap());
                told += 1;
            }
        }
        child.kill().unwrap();
        child.wait().unwrap();
        // What it told between the last line and its end counts too.
        for line in lines.map_while(Result::ok) {
            if let Some((_, second)) = line.split_once("committed ") {
                committed.extend(second.parse::<i64>());
            }
        }
    }
    let (first, last) = (committed[0], *committed.last().unwrap());
    let store = open(folder.path(), &clock()).await;
    let history = store
        .history(&query("a", first, last + 1, 5_000))
        .await
        .unwrap();
    let found: Vec<_> = history
        .stretches
        .iter()
        .map(|stretch| stretch.t_s)
        .collect();
    for second in &committed {
        assert!(found.contains(second), "second {second} is lost");
    }
    store.close().await.unwrap();
    let check: String = sqlx::query_scalar("PRAGMA integrity_check")
        .fetch_one(&mut raw(folder.path()).await)
        .await
        .unwrap();
    assert_eq!(check, "ok");
}

#[tokio::test]
async fn the_database_is_durable_and_checked() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path(), &clock()).await;
    let mut raw = raw(folder.path()).await;
    let mode: String = sqlx::query_scalar("PRAGMA journal_mode")
        .fetch_one(&mut raw)
        .await
        .unwrap();
    assert_eq!(mode, "wal");
    let (found, known) = store.schema().await.unwrap();
    assert_eq!(found, known);
    store.probe().await.unwrap();
}

#[tokio::test]
async fn a_second_process_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let clock = clock();
    let store = open(folder.path(), &clock).await;
    let refused = crate::open(folder.path(), Arc::clone(&clock) as _)
        .await
        .unwrap_err();
    assert!(
        refused.to_string().contains("in use by another fleetcal"),
        "{refused}"
    );
    drop(store);
}

#[tokio::test]
async fn a_newer_schema_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let clock = clock();
    open(folder.path(), &clock).await.close().await.unwrap();
    sqlx::query(
        "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time)
         VALUES (99991231235959, 'later', TRUE, x'00', 0)",
    )
    .execute(&mut raw(folder.path()).await)
    .await
    .unwrap();
    let refused = crate::open(folder.path(), clock as _).await.unwrap_err();
    assert!(
        matches!(
            refused,
            StoreError::NewerSchema {
                found: 99_991_231_235_959,
                ..
            }
        ),
        "{refused}"
    );
}

#[tokio::test]
async fn what_is_no_database_is_refused_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("fleetcal.db");
    std::fs::write(&database, "not a database, but a long letter ".repeat(100)).unwrap();
    let refused = crate::open(folder.path(), clock() as _).await.unwrap_err();
    assert!(
        matches!(
            refused,
            StoreError::Database { .. } | StoreError::Migration(_)
        ),
        "{refused}"
    );
    assert!(
        std::fs::read_to_string(&database)
            .unwrap()
            .starts_with("not a database")
    );
}

#[tokio::test]
async fn a_full_queue_refuses_and_counts() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path(), &clock()).await;
    // One thread: the writer cannot run before the first await.
    let sent = limits::STORE_QUEUE_MAX as i64 + 100;
    for second in 0..sent {
        record(&store, "a", NOW_S + second, 0.0);
    }
    assert_eq!(store.counters().refused, 100);
    store.flush().await.unwrap();
    let counters = store.counters();
    assert_eq!(counters.history_rows + counters.refused, sent as u64);
    assert_eq!(counters.waiting, 0);
}

#[tokio::test]
async fn a_locked_database_refuses_who_waits_and_keeps_the_history() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path(), &clock()).await;
    let mut other = raw(folder.path()).await;
    let lock = other.begin_with("BEGIN IMMEDIATE").await.unwrap();
    record(&store, "a", NOW_S, 0.25);
    let refused = store.transact(AddUser("ann")).await.unwrap_err();
    assert!(matches!(refused, StoreError::Database { .. }), "{refused}");
    // Readers are not kept waiting.
    assert!(store.load_robots().await.unwrap().is_empty());
    lock.rollback().await.unwrap();
    store.flush().await.unwrap();
    let history = store
        .history(&query("a", NOW_S, NOW_S + 1, 2))
        .await
        .unwrap();
    assert_eq!(history.stretches.len(), 1);
    // The history's own commit, by the writer's clock, may have met the lock as well.
    let counters = store.counters();
    assert_eq!(counters.lost, 0);
    assert!(counters.failed_commits >= 1, "{counters:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn readers_run_beside_the_writer() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path(), &clock()).await;
    let readers = (0..8).map(|_| {
        let store = store.clone();
        tokio::spawn(async move {
            let mut seen = 0;
            while seen < 300 {
                let history = store
                    .history(&query("a", NOW_S, NOW_S + 300, 600))
                    .await
                    .unwrap();
                assert!(
                    history.stretches.len() >= seen,
                    "a reader went back in time"
                );
                seen = history.stretches.len();
            }
        })
    });
    let readers: Vec<_> = readers.collect();
    for second in 0..300 {
        record(&store, "a", NOW_S + second, 0.5);
        store.flush().await.unwrap();
    }
    let all = futures::future::join_all(readers);
    for reader in tokio::time::timeout(Duration::from_secs(30), all)
        .await
        .unwrap()
    {
        reader.unwrap();
    }
}
