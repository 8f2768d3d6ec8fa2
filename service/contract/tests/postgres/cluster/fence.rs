//! Fence of a tenure: nothing of an ended one is committed behind its end.

use std::time::Duration;

use fleetcal_cluster::Tenure;
use fleetcal_contract::{NOW_S, query, record};
use fleetcal_model::{RobotId, RobotTime};
use fleetcal_postgres::Fencing;
use fleetcal_store::cluster::TakeForDead;
use fleetcal_store::database_url::PostgresUrl;
use tokio::time::{Instant as Time, timeout};

use super::instance::{Instance, MOMENT, database, end_lease};
use fleetcal_contract::own_server::{Beside, psql};

/// Returns the number of stored seconds of a robot's history.
async fn seconds(instance: &Instance, robot: &RobotId) -> usize {
    let all = query(robot.as_str(), NOW_S, NOW_S + 100, 600);
    let history = instance.store.history(&all).await.unwrap();
    history.stretches.len()
}

/// Passes the output of a robot's estimator in second `t_s` to the store.
fn tell(instance: &Instance, robot: &RobotId, t_s: i64) {
    record(&instance.store, robot.as_str(), t_s, 0.1);
    let state = vec![2, t_s as u8];
    let stamp = RobotTime(t_s);
    instance.store.save_checkpoint(robot, stamp, state);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_instance_writes_of_its_own_robots_alone() {
    let (url, robots) = database(2).await;
    let a = Instance::join(&url, "a").await;
    a.claim(&robots[..1], 1).await;
    for robot in &robots {
        tell(&a, robot, NOW_S);
    }
    a.store.flush().await.unwrap();
    assert_eq!(seconds(&a, &robots[0]).await, 1);
    assert_eq!(seconds(&a, &robots[1]).await, 0);
    let counters = a.store.counters();
    assert_eq!((counters.fenced, counters.history_rows), (2, 1));
    let stored = a.store.load_checkpoints_of(&robots).await.unwrap();
    assert_eq!(stored.len(), 1);
    assert_eq!(stored[0].state, [2, NOW_S as u8]);
}

/// Checks the rows that wait in memory when the seat is lost, as in a process that was frozen
/// before it wrote.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_waited_while_its_seat_was_taken_for_dead_is_not_written() {
    let (url, robots) = database(3).await;
    let a = Instance::join(&url, "a").await;
    let b = Instance::join(&url, "b").await;
    a.claim(&robots, 1).await;
    for robot in &robots {
        tell(&a, robot, NOW_S);
    }
    a.store.flush().await.unwrap();
    assert_eq!(seconds(&a, &robots[0]).await, 1);

    // Somebody who takes it for dead has its row, and the write waits before its fence.
    let mut taker = Beside::run(
        &url,
        "BEGIN; SELECT FROM instance WHERE id = 'a' FOR UPDATE",
    );
    for robot in &robots {
        tell(&a, robot, NOW_S + 1);
    }
    let mut flushing = std::pin::pin!(a.store.flush());
    assert!(timeout(MOMENT, &mut flushing).await.is_err());
    let dead = "UPDATE instance SET incarnation = incarnation + 1, ended_ns = clock_ns()
        WHERE id = 'a'";
    let free = "UPDATE robot_owner SET instance = NULL, incarnation = NULL, free_since_ns = 1";
    taker.go_on(&format!("{dead}; {free}; COMMIT"));
    flushing.await.unwrap();
    assert_eq!(seconds(&b, &robots[0]).await, 1, "no late row");
    // Of each robot a second, its latest estimate, and its state.
    assert_eq!(a.store.counters().fenced, 3 * 3);
    assert!(!a.renew().await);

    b.claim(&robots, 10).await;
    // Its own claims are as they were: nobody has told it yet.
    tell(&a, &robots[1], NOW_S + 2);
    tell(&b, &robots[1], NOW_S + 3);
    a.store.flush().await.unwrap();
    b.store.flush().await.unwrap();
    let stored = b.store.load_checkpoints_of(&robots[1..2]).await.unwrap();
    assert_eq!(stored[0].stamp_ns, RobotTime(NOW_S + 3));
    assert_eq!(seconds(&b, &robots[1]).await, 2);
}

/// Locks a table, so that its writers wait.
fn hold_table(url: &PostgresUrl, table: &str) -> Beside {
    Beside::run(url, &format!("BEGIN; LOCK TABLE {table} IN EXCLUSIVE MODE"))
}

/// Result of a takeover in the middle of a write.
struct Met {
    /// True if it waited for the end of the write.
    waited: bool,
    /// Rows that were written after its end.
    late: usize,
}

/// Declares an instance dead while it is between its fence and its rows, like a process that is
/// frozen there and continues afterwards.
async fn takeover_in_the_midst(fencing: Fencing) -> Met {
    let (url, robots) = database(1).await;
    let a = Instance::join_with(&url, "a", fencing).await;
    let b = Instance::join(&url, "b").await;
    a.claim(&robots, 1).await;
    // So that its partition is there.
    tell(&a, &robots[0], NOW_S);
    a.store.flush().await.unwrap();
    let frozen = hold_table(&url, "checkpoint");
    tell(&a, &robots[0], NOW_S + 1);
    let store = a.store.clone();
    let flushing = tokio::spawn(async move { store.flush().await });
    wait_for_writer(&url, "checkpoint").await;
    end_lease(&url, "a");
    let (registry, seat) = (b.registry.clone(), b.seat.clone());
    let mut taking =
        tokio::spawn(async move { registry.take_for_dead(&seat, TakeForDead::LeaseEnded).await });
    let at_once = timeout(MOMENT, &mut taking).await;
    let waited = at_once.is_err();
    let (before, taken) = if waited {
        // The write goes on first, and is there before the takeover is.
        drop(frozen);
        flushing.await.unwrap().unwrap();
        let before = seconds(&b, &robots[0]).await;
        (before, taking.await.unwrap())
    } else {
        // The takeover is over: nothing may come any more.
        let before = seconds(&b, &robots[0]).await;
        drop(frozen);
        flushing.await.unwrap().unwrap();
        (before, at_once.unwrap().unwrap())
    };
    assert_eq!(taken.unwrap(), std::slice::from_ref(&a.seat));
    b.claim(&robots, 10).await;
    tell(&a, &robots[0], NOW_S + 2);
    a.store.flush().await.unwrap();
    Met {
        waited,
        late: seconds(&b, &robots[0]).await - before,
    }
}

/// Waits until the instance's writer waits for a table.
async fn wait_for_writer(url: &PostgresUrl, table: &str) {
    let began = Time::now();
    let waiting = format!(
        "SELECT count(*) FROM pg_locks WHERE relation = '{table}'::regclass AND NOT granted"
    );
    while psql(url, &waiting).trim() != "1" {
        assert!(began.elapsed() < Duration::from_secs(5));
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_takeover_waits_for_a_write_that_is_under_way_and_none_comes_behind_it() {
    for _ in 0..3 {
        let met = takeover_in_the_midst(Fencing::Locked).await;
        assert!(met.waited);
        assert_eq!(met.late, 0);
    }
}

/// Shows that the test above can fail.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn without_the_lock_of_the_fence_a_late_row_is_found() {
    let met = takeover_in_the_midst(Fencing::Unlocked).await;
    assert!(!met.waited);
    assert_eq!(met.late, 1);
}

/// Freezes a process in the middle of a transaction: it holds its locks for two seconds, and its
/// uncommitted writes are undone.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_frozen_transaction_keeps_nobody_waiting_for_long() {
    let (url, robots) = database(1).await;
    let b = Instance::join(&url, "b").await;
    let a = Instance::join(&url, "a").await;
    a.claim(&robots, 1).await;
    let timeout = "SET idle_in_transaction_session_timeout = '2s'";
    let write = "BEGIN; SELECT FROM instance WHERE id = 'a' FOR KEY SHARE";
    let frozen = Beside::run(&url, &format!("{timeout}; {write}"));
    end_lease(&url, "a");
    let began = Time::now();
    let mut tries = 0;
    let taken = loop {
        tries += 1;
        let taken = b.registry.take_for_dead(&b.seat, TakeForDead::LeaseEnded);
        match taken.await {
            Ok(taken) => break taken,
            Err(error) => assert!(began.elapsed() < Duration::from_secs(4), "{error:?}"),
        }
    };
    println!("taken for dead after {:?}, {tries} tries", began.elapsed());
    assert_eq!(taken, std::slice::from_ref(&a.seat));
    drop(frozen);
}

/// Returns a robot to an instance while rows of its former tenure wait: they belong to another
/// time.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn rows_of_a_former_tenure_do_not_pass_for_those_of_the_next() {
    let (url, robots) = database(1).await;
    let a = Instance::join(&url, "a").await;
    let tenure = |tenures: Vec<Tenure>| tenures.into_iter().next().unwrap();
    tenure(a.claim(&robots, 1).await);
    tell(&a, &robots[0], NOW_S);
    a.store.claims().remove(&robots[0]);
    a.registry.free(&a.seat, &robots).await.unwrap();
    tell(&a, &robots[0], NOW_S + 1);
    tenure(a.claim(&robots, 2).await);
    tell(&a, &robots[0], NOW_S + 2);
    a.store.flush().await.unwrap();
    let all = query(robots[0].as_str(), NOW_S, NOW_S + 100, 600);
    let history = a.store.history(&all).await.unwrap();
    let there: Vec<_> = history
        .stretches
        .iter()
        .map(|one| one.t_s - NOW_S)
        .collect();
    // The first one may have been written in its own time.
    assert!(there == [2] || there == [0, 2], "{there:?}");
}
