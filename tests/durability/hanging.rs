//! A database that does not answer for a while: another process locks it, or a sync hangs.

use std::time::{Duration, Instant};

use fleetcal_tests::service::{self, Service};
use sqlx::{ConnectOptions, Connection};

use crate::injected::{Faults, Robots, SYNC, can_inject, settle};

/// A write is answered within this, whatever the database does.
const ANSWERED_WITHIN: Duration = Duration::from_secs(5);
/// How long the database does not answer; `HANGS_FOR_S` asks for another time.
const HANGS_FOR_S: u64 = 12;

fn hangs_for() -> Duration {
    let text = std::env::var("HANGS_FOR_S");
    Duration::from_secs(text.map_or(HANGS_FOR_S, |text| text.parse().unwrap()))
}

/// Writes until `end`; every answer comes in time, and the process is not blamed for it.
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
    let mut other = sqlx::sqlite::SqliteConnectOptions::new()
        .filename(service.data().join("fleetcal.db"))
        .connect()
        .await
        .unwrap();
    let lock = other.begin_with("BEGIN IMMEDIATE").await.unwrap();
    let end = service::now() + hangs_for();
    tokio::task::block_in_place(|| {
        write_until(&service, &mut robots, end);
        assert_eq!(service.status("/readyz", None), 503);
    });
    lock.rollback().await.unwrap();
    let recovered = tokio::task::block_in_place(|| robots.recover(&service));
    println!("writing works after {recovered:?}");
    settle(&service);
    robots.check(&service);
    assert_eq!(service.metric("fleetcal_store_lost_total"), 0);
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
