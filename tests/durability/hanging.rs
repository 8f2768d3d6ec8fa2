//! A database that does not answer for a while: another process locks it, or a sync hangs.

use std::time::{Duration, Instant};

use fleetcal_tests::service::{self, Service};
use serde_json::json;
use sqlx::{ConnectOptions, Connection};

use crate::durability::injected::{Faults, Robots, SYNC, can_inject, settle};

/// Time within which a write is answered, whatever the database does.
const ANSWERED_WITHIN: Duration = Duration::from_secs(5);
/// Time for which the database does not answer; `HANGS_FOR_S` sets another time.
const HANGS_FOR_S: u64 = 7;

fn hangs_for() -> Duration {
    let text = std::env::var("HANGS_FOR_S");
    Duration::from_secs(text.map_or(HANGS_FOR_S, |text| text.parse().unwrap()))
}

/// Writes until `end`; every answer comes in time, and the process counts as healthy.
fn write_until(service: &Service, robots: &mut Robots, end: Instant) {
    let (before, mut slowest) = (robots.refused(), Duration::ZERO);
    while service::now() < end {
        let asked = service::now();
        robots.register(service);
        slowest = slowest.max(asked.elapsed());
        assert!(slowest < ANSWERED_WITHIN, "answered after {slowest:?}");
        assert_eq!(service.status("/healthz", None), 200);
    }
    let refused = robots.refused() - before;
    println!("{refused} writes refused, the slowest after {slowest:?}");
    assert!(refused > 0, "the database answered");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_locked_database_is_told_in_time_and_waited_for() {
    let service = Service::start(&[]);
    let mut robots = Robots::default();
    robots.register(&service);
    let lock = locked(&service).await;
    let end = service::now() + hangs_for();
    tokio::task::block_in_place(|| {
        write_until(&service, &mut robots, end);
        assert_eq!(service.status("/readyz", None), 503);
    });
    lock.close().await.unwrap();
    let recovered = tokio::task::block_in_place(|| robots.recover(&service));
    println!("writing works after {recovered:?}");
    settle(&service);
    robots.check(&service);
    assert_eq!(service.metric("fleetcal_store_lost_total"), 0);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn approvals_that_find_the_database_locked_are_answered_in_time() {
    let service = Service::start(&["tugger_01"]);
    let [ana, bo] = [("approver", "ana"), ("operator", "bo")]
        .map(|(role, name)| service.made_token(&["--role", role, "--name", name]));
    let values = json!({
        "robot": "tugger_01", "reason": "by tape",
        "values": {
            "steering_offset_rad": 0.02, "lidar_x_m": 0.43, "lidar_y_m": 0.01, "lidar_yaw_rad": 0.01,
        },
    });
    let key = "Idempotency-Key: k\r\n";
    let proposal = service.send("POST /api/v1/proposals", &bo, key, &values.to_string());
    let one = json!({
        "id": proposal["id"], "version": 1, "sha256": proposal["revision"]["sha256"],
    });
    let body = json!({ "proposals": vec![one; 40] }).to_string();
    let lock = locked(&service).await;
    let (answer, took) = tokio::task::block_in_place(|| {
        let asked = service::now();
        let answer = service.send("POST /api/v1/proposals/approve", &ana, "", &body);
        (answer, asked.elapsed())
    });
    assert!(took < ANSWERED_WITHIN, "answered after {took:?}");
    let items = answer["items"].as_array().unwrap().iter();
    let codes: Vec<_> = items.map(|item| item["problem"]["code"].as_str()).collect();
    println!("answered after {took:?}: {codes:?}");
    let honest = ["database_unavailable", "outcome_unknown", "not_tried"].map(Some);
    assert!(codes.iter().all(|code| honest.contains(code)), "{codes:?}");
    assert_eq!(codes.last(), Some(&Some("not_tried")), "{codes:?}");
    lock.close().await.unwrap();
}

/// Locks a service's database until the connection is closed.
pub async fn locked(service: &Service) -> sqlx::SqliteConnection {
    let mut other = sqlx::sqlite::SqliteConnectOptions::new()
        .filename(service.data().join("fleetcal.db"))
        .connect()
        .await
        .unwrap();
    sqlx::query("BEGIN IMMEDIATE")
        .execute(&mut other)
        .await
        .unwrap();
    other
}

#[test]
fn a_hanging_sync_is_told_in_time_and_waited_for() {
    if !can_inject() {
        return;
    }
    let mut service = Service::start(&[]);
    let mut robots = Robots::default();
    robots.register(&service);
    let hang = hangs_for();
    let delay = format!("delay_enter={}s:when=1", hang.as_secs());
    let faults = Faults::begin(&service, SYNC, &delay);
    write_until(&service, &mut robots, service::now() + hang);
    faults.end();
    let recovered = robots.recover(&service);
    println!("writing works after {recovered:?}");
    settle(&service);
    service.kill();
    service.restart();
    robots.check(&service);
}
