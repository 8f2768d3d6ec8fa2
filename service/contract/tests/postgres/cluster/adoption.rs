//! Adoption of a robot that another instance estimated before.

use fleetcal_contract::{NOW_S, record};
use fleetcal_model::{AuditId, RobotTime};
use fleetcal_store::EventKind;

use super::instance::{Instance, database};
use fleetcal_contract::own_server::psql;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn minutes_that_a_dead_owner_left_are_rolled_up_by_the_next() {
    let (url, robots) = database(3).await;
    let a = Instance::join(&url, "a").await;
    a.claim(&robots, 1).await;
    for second in 0..90 {
        for robot in &robots[..2] {
            record(&a.store, robot.as_str(), NOW_S + second, 0.1);
        }
    }
    a.store
        .save_checkpoint(&robots[0], RobotTime(5), vec![2, 9]);
    a.store.flush().await.unwrap();
    // As if it had ended before it rolled anything up.
    psql(&url, "DELETE FROM history_minute; DELETE FROM history_hour");
    a.registry.leave(&a.seat).await.unwrap();
    let b = Instance::join(&url, "b").await;
    b.claim(&robots[..2], 10).await;
    b.store.flush().await.unwrap();
    let minutes = "SELECT count(*) FROM history_minute";
    assert_eq!(psql(&url, minutes).trim(), "0", "before it adopts them");
    b.store.adopted(&robots);
    b.store.flush().await.unwrap();
    assert_eq!(psql(&url, minutes).trim(), "4");
    let counts = "SELECT count FROM history_minute
        WHERE robot = (SELECT key FROM robot WHERE id = 'robot_000') ORDER BY t";
    assert_eq!(psql(&url, counts), "60\n30\n");
    // The start is noted where an estimator goes on from a state, once.
    b.store.flush().await.unwrap();
    for (robot, starts) in robots.iter().zip([1, 0, 0]) {
        let events = b.store.events(robot, None, 10).await.unwrap();
        let started = |kind| kind == EventKind::ServiceStarted;
        let found = events.iter().filter(|one| started(one.event.kind)).count();
        assert_eq!(found, starts, "{robot}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_instance_deletes_nothing_without_the_duty() {
    let (url, robots) = database(1).await;
    let a = Instance::join(&url, "a").await;
    a.claim(&robots, 1).await;
    record(&a.store, robots[0].as_str(), NOW_S - 10 * 86_400, 0.1);
    a.store.flush().await.unwrap();
    let old = "SELECT count(*) FROM history_second";
    tokio::time::sleep(std::time::Duration::from_millis(2_500)).await;
    assert_eq!(psql(&url, old).trim(), "1");
    a.store.set_retention(true);
    for _ in 0..100 {
        if a.store.counters().pruned_rows > 0 {
            break;
        }
        tokio::time::sleep(std::time::Duration::from_millis(100)).await;
    }
    assert_eq!(psql(&url, old).trim(), "0");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_audit_is_followed_in_its_order() {
    let (url, _) = database(1).await;
    let a = Instance::join(&url, "a").await;
    let b = Instance::join(&url, "b").await;
    let last = b.store.audit_last().await.unwrap();
    for number in 0..5 {
        let decision = crate::decision::Decide(format!("number {number}"));
        a.store.transact(decision).await.unwrap();
    }
    let rows = b.store.audit_after(last, 3).await.unwrap();
    let ids: Vec<_> = rows.iter().map(|row| row.id.0 - last.0).collect();
    assert_eq!(ids, [1, 2, 3]);
    let rest = b.store.audit_after(rows[2].id, 100).await.unwrap();
    assert_eq!(rest.len(), 2);
    let end = b.store.audit_last().await.unwrap();
    assert_eq!(end, AuditId(last.0 + 5));
    assert_eq!(b.store.audit_after(end, 100).await.unwrap(), []);
}
