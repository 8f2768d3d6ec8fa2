//! A disk that is full for a while: who asks is told so, writing works again by itself, and every
//! row is either in the database or counted as lost.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use fleetcal_clock::{SharedClock, SystemClock};
use fleetcal_domain::robot::{HistoryEvent, Journal, ServiceEvent, ServiceEventKind};
use fleetcal_model::{RobotTime, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::EstimateDocument;
use fleetcal_store::{Store, StoreError};
use fleetcal_tests::service::{self, Service, wait_for};
use serde_json::json;
use sqlx::{ConnectOptions, Connection};

use crate::durability::small_disk::SmallDisk;

/// Time after the last fault within which writing has to work again.
const RECOVERS_WITHIN: Duration = Duration::from_secs(5);
/// Size of the disk, MiB.
const DISK_MIB: u32 = 8;
/// Robots with written history.
const ROBOTS: i64 = 20;

/// Source of history that counts its rows.
struct Offers {
    store: Store,
    /// Message time of the first second, s. It is recent, because old rows are deleted.
    first_s: i64,
    seconds: i64,
}

impl Offers {
    /// Offers some seconds of every robot's history.
    fn offer(&mut self, seconds: i64) {
        for second in self.seconds..self.seconds + seconds {
            for robot in 0..ROBOTS {
                let t_s = self.first_s + second;
                self.store
                    .record_history(&estimate(robot, t_s), WallTime(t_s * 1_000_000_000));
            }
            // An event that is an event of its own each time: written twice, it would count twice.
            let event = HistoryEvent::Service(ServiceEvent {
                kind: ServiceEventKind::Configured,
                stamp_ns: RobotTime(1),
                note: String::new(),
            });
            let robot = RobotId::parse("tugger_0").unwrap();
            Journal::record_event(&self.store, &robot, &Arc::new(event));
        }
        self.seconds += seconds;
    }

    fn offered(&self) -> u64 {
        (self.seconds * ROBOTS) as u64
    }

    /// Offers history until the disk has no room for it.
    async fn offer_until_refused(&mut self) {
        for _ in 0..1_000 {
            self.offer(1);
            if self.store.flush().await.is_err() {
                return;
            }
        }
        panic!("a full disk refused nothing");
    }
}

fn estimate(robot: i64, t_s: i64) -> EstimateDocument {
    let parameter =
        |unit: &str| json!({"value": 0.5, "sigma": 0.1, "unit": unit, "status": "learning"});
    let document = json!({
        "robot": format!("tugger_{robot}"),
        "stamp_ns": t_s * 1_000_000_000,
        "time_s": 1.0,
        "distance_m": 2.0,
        "parameters": {
            "steering_offset": parameter("rad"),
            "lidar_x": parameter("m"),
            "lidar_y": parameter("m"),
            "lidar_yaw": parameter("rad"),
            "speed_scale": parameter("1"),
            "wheelbase": parameter("m"),
            "time_offset": parameter("s"),
            "steering_gain": parameter("1"),
        },
        "consistency": {"nis_mean": 3.0, "nis_dof": 3.0, "samples": 10},
        "counts": fleetcal_model::Counts::default(),
        "lidar_in_base_link": null,
    });
    serde_json::from_value(document).unwrap()
}

async fn open(data: &Path) -> Offers {
    let clock: SharedClock = Arc::new(SystemClock::start());
    Offers {
        store: fleetcal_sqlite::open(data, Arc::clone(&clock))
            .await
            .unwrap(),
        first_s: clock.now().whole_s(),
        seconds: 0,
    }
}

/// Returns the seconds of history in the database, as rows and as counted by minutes and hours; and
/// the events.
async fn rows(data: &Path) -> (i64, i64, i64, i64) {
    let mut database = sqlx::sqlite::SqliteConnectOptions::new()
        .filename(data.join("fleetcal.db"))
        .connect()
        .await
        .unwrap();
    let counts = sqlx::query_as(
        "SELECT (SELECT count(*) FROM history_second),
                (SELECT sum(count) FROM history_minute), (SELECT sum(count) FROM history_hour),
                (SELECT count(*) FROM robot_event WHERE kind = 'configured')",
    );
    let counts = counts.fetch_one(&mut database).await.unwrap();
    database.close().await.unwrap();
    counts
}

async fn recover(store: &Store) -> Duration {
    let began = service::now();
    while let Err(error) = store.probe().await {
        assert!(
            began.elapsed() < RECOVERS_WITHIN,
            "still not after {:?}: {error}",
            began.elapsed()
        );
    }
    began.elapsed()
}

#[tokio::test]
async fn history_on_a_full_disk_is_written_or_counted() {
    let Some(disk) = SmallDisk::mount(DISK_MIB) else {
        return;
    };
    let mut offers = open(&disk.data()).await;
    offers.offer(3);
    offers.store.flush().await.unwrap();
    for _ in 0..3 {
        disk.fill();
        offers.offer_until_refused().await;
        offers.offer(2);
        tokio::time::sleep(Duration::from_millis(1_500)).await;
        let counters = offers.store.counters();
        assert!(counters.waiting >= 2 * ROBOTS as u64, "{counters:?}");
        assert_eq!(counters.lost, 0, "{counters:?}");
        disk.empty();
        println!(
            "writing works again after {:?}",
            recover(&offers.store).await
        );
    }
    offers.store.flush().await.unwrap();
    let counters = offers.store.counters();
    assert_eq!(counters.history_rows, offers.offered(), "{counters:?}");
    assert_eq!((counters.waiting, counters.lost), (0, 0), "{counters:?}");
    let written = offers.offered() as i64;
    let found = rows(&disk.data()).await;
    assert_eq!(found, (written, written, written, offers.seconds));

    disk.fill();
    offers.offer_until_refused().await;
    offers.offer(2);
    let ended = offers.store.close().await;
    assert!(
        matches!(ended, Err(StoreError::RowsLost { .. })),
        "{ended:?}"
    );
    let counters = offers.store.counters();
    assert_eq!(
        counters.history_rows + counters.lost_history,
        offers.offered(),
        "{counters:?}"
    );
    assert!(counters.lost_history >= 2 * ROBOTS as u64, "{counters:?}");
    disk.empty();
    let written = counters.history_rows as i64;
    let (seconds, in_minutes, in_hours, _) = rows(&disk.data()).await;
    assert_eq!((seconds, in_minutes, in_hours), (written, written, written));
}

/// Registers robots until one is refused; adds the accepted ones.
fn register_until_refused(service: &Service, taken: &mut Vec<String>) {
    for _ in 0..2_000 {
        let id = format!("tugger_{}", taken.len());
        match register(service, &id) {
            201 => taken.push(id),
            503 => return,
            other => panic!("{id}: {other}"),
        }
    }
    panic!("a full disk refused nothing");
}

/// Registers robots until smaller writes find no room either.
fn refuse_everything(service: &Service, taken: &mut Vec<String>) {
    wait_for("unreadiness", || {
        register_until_refused(service, taken);
        (service.status("/readyz", None) == 503).then_some(())
    });
}

fn register(service: &Service, id: &str) -> u16 {
    let vehicle = json!({"model": "bicycle", "wheelbase_m": 1.2});
    let path = format!("/api/v1/robots/{id}");
    service.try_put(&path, &vehicle).unwrap().status
}

#[test]
fn a_service_writes_again_once_its_disk_has_room() {
    let Some(disk) = SmallDisk::mount(DISK_MIB) else {
        return;
    };
    let mut service = Service::start_with_data(&disk.data());
    let mut taken = Vec::new();
    for _ in 0..2 {
        disk.fill();
        refuse_everything(&service, &mut taken);
        assert_eq!(service.status("/healthz", None), 200);
        disk.empty();
        let began = service::now();
        let id = format!("tugger_{}", taken.len());
        while register(&service, &id) != 201 {
            let waited = began.elapsed();
            assert!(waited < RECOVERS_WITHIN, "not after {waited:?}");
        }
        println!("writing works again after {:?}", began.elapsed());
        taken.push(id);
        wait_for("readiness", || {
            (service.status("/readyz", None) == 200).then_some(())
        });
    }
    // The first use of a token is noted, and waits to be written.
    let token = service.made_token(&["--role", "viewer", "--name", "wall"]);
    disk.fill();
    refuse_everything(&service, &mut taken);
    assert_eq!(service.status("/api/v1/robots", Some(&token)), 200);
    wait_for("what waits", || {
        (service.metric("fleetcal_store_waiting") > 0).then_some(())
    });
    let (status, _) = service.terminate();
    let logged = service.logged();
    assert_eq!(status.code(), Some(74), "{logged}");
    assert!(logged.contains("rows are lost"), "{logged}");
    disk.empty();
    service.restart();
    for id in &taken {
        service.robot(id);
    }
}
