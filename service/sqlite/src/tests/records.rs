//! Robots, checkpoints, current estimates and events.

use fleetcal_domain::access::Actor;
use fleetcal_domain::robot::{HistoryEvent, Journal, RobotConfig};
use fleetcal_model::NoteKind;
use fleetcal_proto::event::RobotEvent;
use fleetcal_store::{EventKind, EventSource, Expected, IdempotencyKey, NewEvent, StoreError};

use super::*;

fn config(wheelbase_m: f64) -> RobotConfig {
    serde_json::from_value(serde_json::json!({"model": "bicycle", "wheelbase_m": wheelbase_m}))
        .unwrap()
}

fn event(note: &str) -> NewEvent {
    NewEvent {
        robot: robot("a"),
        kind: EventKind::Reassembled,
        stamp_ns: 5,
        received_ns: NOW_S * NS,
        source: EventSource::Person,
        author: Some("Ann".to_owned()),
        note: Some(note.to_owned()),
        details: Some(serde_json::json!({"change": {"lidar_x": 0.1}})),
    }
}

#[tokio::test]
async fn everything_is_there_after_a_restart() {
    let folder = tempfile::tempdir().unwrap();
    let clock = clock();
    let store = open(folder.path(), &clock).await;
    store
        .save_robot(
            &robot("a"),
            &config(1.2),
            Expected::Absent,
            Actor::service(),
        )
        .await
        .unwrap();
    store.save_checkpoint(&robot("a"), 7, r#"{"state": [0.1]}"#.to_owned());
    store.save_checkpoint(&robot("a"), 8, r#"{"state": [0.2]}"#.to_owned());
    record(&store, "a", NOW_S, 0.1);
    record(&store, "a", NOW_S + 1, 0.2);
    let told = store
        .record_event(event("new bracket"), Actor::service(), None)
        .await
        .unwrap();
    store.close().await.unwrap();
    assert!(matches!(store.flush().await, Err(StoreError::Closed)));
    drop(store);

    let store = open(folder.path(), &clock).await;
    let robots = store.load_robots().await.unwrap();
    assert_eq!(robots.len(), 1);
    assert_eq!(
        (robots[0].version, &robots[0].config),
        (1, &Some(config(1.2)))
    );
    let checkpoints = store.load_checkpoints().await.unwrap();
    assert_eq!(checkpoints.len(), 1);
    assert_eq!(
        (checkpoints[0].stamp_ns, checkpoints[0].state.as_str()),
        (8, r#"{"state": [0.2]}"#)
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
    assert_eq!(events[1], told);
}

#[tokio::test]
async fn a_configuration_is_changed_only_by_who_saw_it() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path(), &clock()).await;
    let save = async |wheelbase_m, expected| {
        store
            .save_robot(
                &robot("a"),
                &config(wheelbase_m),
                expected,
                Actor::service(),
            )
            .await
    };
    assert_eq!(save(1.0, Expected::Version(0)).await.unwrap(), 1);
    assert_eq!(save(1.1, Expected::Version(1)).await.unwrap(), 2);
    for stale in [Expected::Absent, Expected::Version(1), Expected::Version(3)] {
        let refused = save(9.0, stale).await.unwrap_err();
        assert!(
            matches!(refused, StoreError::VersionConflict { found: 2, .. }),
            "{refused}"
        );
    }
    assert_eq!(save(1.2, Expected::Any).await.unwrap(), 3);
    let stored = store.load_robot(&robot("a")).await.unwrap().unwrap();
    assert_eq!((stored.version, stored.config), (3, Some(config(1.2))));
    assert_eq!(store.load_robot(&robot("b")).await.unwrap(), None);
}

#[tokio::test]
async fn of_many_writers_with_the_same_version_one_wins() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path(), &clock()).await;
    let tries = (0..50).map(|number| {
        let store = store.clone();
        async move {
            let wheelbase_m = 1.0 + f64::from(number) / 100.0;
            store
                .save_robot(
                    &robot("a"),
                    &config(wheelbase_m),
                    Expected::Absent,
                    Actor::service(),
                )
                .await
                .is_ok()
        }
    });
    let won = futures::future::join_all(tries).await;
    assert_eq!(won.into_iter().filter(|won| *won).count(), 1);
}

#[tokio::test]
async fn a_repeated_request_is_answered_with_the_same_event() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path(), &clock()).await;
    let key = |sha: u8| {
        Some(IdempotencyKey {
            key: "k".to_owned(),
            request_sha256: [sha; 32],
        })
    };
    let first = store
        .record_event(event("x"), Actor::service(), key(1))
        .await
        .unwrap();
    let second = store
        .record_event(event("x"), Actor::service(), key(1))
        .await
        .unwrap();
    assert_eq!(
        (first.id, first.repeated, second.repeated),
        (second.id, false, true)
    );
    let refused = store
        .record_event(event("y"), Actor::service(), key(2))
        .await
        .unwrap_err();
    assert!(matches!(refused, StoreError::KeyReused), "{refused}");
    // Without a key, or for another robot, it is another event.
    assert_ne!(
        store
            .record_event(event("x"), Actor::service(), None)
            .await
            .unwrap()
            .id,
        first.id
    );
    let other = NewEvent {
        robot: robot("b"),
        ..event("x")
    };
    assert!(
        !store
            .record_event(other, Actor::service(), key(1))
            .await
            .unwrap()
            .repeated
    );
    assert_eq!(store.events(&robot("a"), None, 10).await.unwrap().len(), 2);
}

#[tokio::test]
async fn a_note_that_comes_again_through_the_fleet_is_one_event() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path(), &clock()).await;
    store
        .record_event(event("new bracket"), Actor::service(), None)
        .await
        .unwrap();
    let note = |note: &str| {
        let note = note.to_owned();
        Arc::new(HistoryEvent::Note(RobotEvent {
            kind: NoteKind::Reassembled,
            stamp_ns: 5,
            note,
        }))
    };
    for text in ["new bracket", "other", "other", "", ""] {
        Journal::record_event(&store, &robot("a"), &note(text));
    }
    store.flush().await.unwrap();
    let events = store.events(&robot("a"), None, 10).await.unwrap();
    let notes: Vec<_> = events
        .iter()
        .map(|record| record.event.note.as_deref())
        .collect();
    assert_eq!(notes, [None, Some("other"), Some("new bracket")]);
}

#[tokio::test]
async fn a_change_that_is_told_again_says_how_far_it_went() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path(), &clock()).await;
    let told = |stamp_ns: i64, moved: serde_json::Value| {
        let change = serde_json::json!({
            "kind": "calibration_changed", "cause": "steering", "time_s": 9.0, "onset_s": 8.0,
            "stamp_ns": stamp_ns, "change": moved,
        });
        let change = HistoryEvent::Change(serde_json::from_value(change).unwrap());
        Journal::record_event(&store, &robot("a"), &Arc::new(change));
    };
    told(5, serde_json::json!({}));
    told(6, serde_json::json!({}));
    told(5, serde_json::json!({"steering_offset": 0.02}));
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
async fn events_come_in_pages() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path(), &clock()).await;
    for number in 0..5 {
        store
            .record_event(event(&number.to_string()), Actor::service(), None)
            .await
            .unwrap();
    }
    let first = store.events(&robot("a"), None, 3).await.unwrap();
    let rest = store
        .events(&robot("a"), Some(first[2].id), 3)
        .await
        .unwrap();
    let notes: Vec<_> = first
        .iter()
        .chain(&rest)
        .map(|record| record.event.note.clone().unwrap())
        .collect();
    assert_eq!(notes, ["4", "3", "2", "1", "0"]);
}
