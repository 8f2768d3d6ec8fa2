//! Robots, checkpoints, current estimates and events.

use std::sync::Arc;
use std::time::Duration;

use fleetcal_contract::{
    KeepRobot, NOW_S, NS, TestDatabase, clock, config, estimate, event, query, record, robot,
};
use fleetcal_domain::robot::{HistoryEvent, Journal};
use fleetcal_model::{RobotTime, Version, WallTime};
use fleetcal_store::{EventKind, StoreError};

#[tokio::test]
async fn everything_is_there_after_a_restart() {
    let database = TestDatabase::new().await;
    let clock = clock();
    let store = database.open(Arc::clone(&clock)).await;
    let keep = KeepRobot(config(1.2), event("new bracket"));
    let told = store.transact(keep).await.unwrap();
    store.save_checkpoint(&robot("a"), RobotTime(7), vec![2, 0, 1]);
    store.save_checkpoint(&robot("a"), RobotTime(8), vec![2, 0, 0xff]);
    record(&store, "a", NOW_S, 0.1);
    record(&store, "a", NOW_S + 1, 0.2);
    store.close().await.unwrap();
    assert!(matches!(store.flush().await, Err(StoreError::Closed)));
    drop(store);

    let store = database.open(Arc::clone(&clock)).await;
    let robots = store.load_robots().await.unwrap();
    assert_eq!(robots.len(), 1);
    assert_eq!(
        (robots[0].version, &robots[0].config),
        (Version(1), &Some(config(1.2)))
    );
    let checkpoints = store.load_checkpoints().await.unwrap();
    assert_eq!(checkpoints.len(), 1);
    assert_eq!(
        (checkpoints[0].stamp_ns, checkpoints[0].state.as_slice()),
        (RobotTime(8), [2, 0, 0xff].as_slice())
    );
    let current = store.load_current().await.unwrap();
    assert_eq!(current[0].estimate, estimate("a", NOW_S + 1, 0.2, 0.0));
    assert_eq!(
        store.last_second(&robot("a")).await.unwrap(),
        Some(NOW_S + 1)
    );
    let history = store
        .history(&query("a", NOW_S, NOW_S + 2, 600))
        .await
        .unwrap();
    assert_eq!(history.stretches.len(), 2);
    let events = store.events(&robot("a"), None, 10).await.unwrap();
    let kinds: Vec<_> = events.iter().map(|record| record.event.kind).collect();
    assert_eq!(kinds, [EventKind::ServiceStarted, EventKind::Reassembled]);
    assert_eq!(
        (events[1].id, &events[1].event),
        (told, &event("new bracket"))
    );
}

#[tokio::test]
async fn a_note_with_a_nul_stops_nothing() {
    let database = TestDatabase::new().await;
    let store = database.open(clock()).await;
    let keep = KeepRobot(config(1.2), event("by\0a person"));
    store.transact(keep).await.unwrap();
    let note = serde_json::json!({"kind": "maintenance", "stamp_ns": 5, "note": "by\0a robot"});
    let note = HistoryEvent::Note(serde_json::from_value(note).unwrap());
    Journal::record_event(&store, &robot("a"), &Arc::new(note));
    record(&store, "a", NOW_S, 0.1);
    store.flush().await.unwrap();
    let events = store.events(&robot("a"), None, 10).await.unwrap();
    let notes: Vec<_> = events
        .iter()
        .map(|record| record.event.note.as_deref().unwrap())
        .collect();
    assert_eq!(notes.len(), 2);
    for note in notes {
        assert!(note.starts_with("by") && note.contains("a "), "{note:?}");
    }
}

#[tokio::test]
async fn a_change_that_is_told_again_says_how_far_it_went() {
    let database = TestDatabase::new().await;
    let store = database.open(clock()).await;
    let told = |stamp_ns: RobotTime, moved: serde_json::Value| {
        let change = serde_json::json!({
            "kind": "calibration_changed", "cause": "steering", "time_s": 9.0, "onset_s": 8.0,
            "stamp_ns": stamp_ns, "change": moved,
        });
        let change = HistoryEvent::Change(serde_json::from_value(change).unwrap());
        Journal::record_event(&store, &robot("a"), &Arc::new(change));
    };
    told(RobotTime(5), serde_json::json!({}));
    told(RobotTime(6), serde_json::json!({}));
    told(RobotTime(5), serde_json::json!({"steering_offset": 0.02}));
    store.flush().await.unwrap();
    let events = store.events(&robot("a"), None, 10).await.unwrap();
    let moved: Vec<_> = events
        .iter()
        .map(|record| record.event.details.as_ref().unwrap()["change"].clone())
        .collect();
    assert_eq!(
        moved,
        [
            serde_json::json!({}),
            serde_json::json!({"steering_offset": 0.02})
        ]
    );
}

#[tokio::test]
async fn the_latest_estimate_is_kept_also_after_the_clock_was_set_back() {
    let database = TestDatabase::new().await;
    let store = database.open(clock()).await;
    store.record_history(&estimate("a", NOW_S, 0.1, 0.0), WallTime(NOW_S * NS));
    store.flush().await.unwrap();
    // By the robot's clock a second later, received 30 days before.
    let later = estimate("a", NOW_S + 1, 0.2, 0.0);
    store.record_history(&later, WallTime((NOW_S - 30 * 86_400) * NS));
    let written = async {
        while store.load_current().await.unwrap()[0].estimate != later {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(30), written)
        .await
        .unwrap();
}
