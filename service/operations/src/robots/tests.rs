//! Configurations and notes, on the real database.

use std::sync::Arc;

use fleetcal_contract::TestDatabase;
use fleetcal_domain::robot::{HistoryEvent, Journal};
use fleetcal_model::{NoteKind, RobotTime, Version, WallTime};
use fleetcal_proto::event::RobotEvent;
use fleetcal_store::{EventKind, EventSource};

use super::*;
use crate::testing::{NOW_NS, clock, open, robot};

fn config(wheelbase_m: f64) -> RobotConfig {
    serde_json::from_value(serde_json::json!({"model": "bicycle", "wheelbase_m": wheelbase_m}))
        .unwrap()
}

fn event(note: &str) -> NewEvent {
    NewEvent {
        robot: robot("a"),
        kind: EventKind::Reassembled,
        stamp_ns: RobotTime(5),
        received_ns: WallTime(NOW_NS),
        source: EventSource::Person,
        author: Some("Ann".to_owned()),
        note: Some(note.to_owned()),
        details: Some(serde_json::json!({"change": {"lidar_x": 0.1}})),
    }
}

#[tokio::test]
async fn a_configuration_is_changed_only_by_who_saw_it() {
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    let save = async |wheelbase_m, expected| {
        let (actor, config) = (Actor::service(), config(wheelbase_m));
        configure(&store, &robot("a"), &config, expected, actor).await
    };
    assert_eq!(
        save(1.0, Expected::Version(Version(0))).await.unwrap(),
        Version(1)
    );
    assert_eq!(
        save(1.1, Expected::Version(Version(1))).await.unwrap(),
        Version(2)
    );
    for stale in [
        Expected::Absent,
        Expected::Version(Version(1)),
        Expected::Version(Version(3)),
    ] {
        let refused = save(9.0, stale).await.unwrap_err();
        assert!(
            matches!(
                refused,
                StoreError::VersionConflict {
                    found: Version(2),
                    ..
                }
            ),
            "{refused}"
        );
    }
    assert_eq!(save(1.2, Expected::Any).await.unwrap(), Version(3));
    let stored = store.load_robot(&robot("a")).await.unwrap().unwrap();
    assert_eq!(
        (stored.version, stored.config),
        (Version(3), Some(config(1.2)))
    );
    assert_eq!(store.load_robot(&robot("b")).await.unwrap(), None);
}

#[tokio::test]
async fn the_author_of_a_drawing_is_who_changed_it_last() {
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    let author = async |x_m: Option<f64>, wheelbase_m: f64, by: &str| {
        let mut config = config(wheelbase_m);
        let drawing = x_m.map(|x_m| serde_json::json!({"x_m": x_m, "y_m": 0, "yaw_rad": 0}));
        config.nominal_extrinsics = drawing.map(|one| serde_json::from_value(one).unwrap());
        let mut actor = Actor::service();
        if by != actor.name {
            actor.authentication = Authentication::Session;
            actor.name = by.to_owned();
        }
        let done = configure(&store, &robot("a"), &config, Expected::Any, actor).await;
        done.unwrap();
        let stored = store.load_robot(&robot("a")).await.unwrap().unwrap();
        stored.drawn_by
    };
    assert_eq!(author(Some(0.4), 1.2, "fleetcal").await, None);
    // Another part of the configuration is no drawing.
    assert_eq!(author(Some(0.4), 1.3, "mallory").await, None);
    for x_m in [2.5, 0.4] {
        let by = author(Some(x_m), 1.3, "mallory").await;
        assert_eq!(by.as_deref(), Some("mallory"));
    }
    let by = author(Some(0.4), 1.2, "carla").await;
    assert_eq!(by.as_deref(), Some("mallory"));
    assert_eq!(author(None, 1.2, "carla").await, None);
    assert_eq!(
        author(Some(0.4), 1.2, "carla").await.as_deref(),
        Some("carla")
    );
    assert_eq!(author(Some(0.41), 1.2, "fleetcal").await, None);
}

#[tokio::test]
async fn of_many_writers_with_the_same_version_one_wins() {
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    let tries = (0..50).map(|number| {
        let store = store.clone();
        async move {
            let wheelbase_m = 1.0 + f64::from(number) / 100.0;
            let (actor, config) = (Actor::service(), config(wheelbase_m));
            configure(&store, &robot("a"), &config, Expected::Absent, actor)
                .await
                .is_ok()
        }
    });
    let won = futures::future::join_all(tries).await;
    assert_eq!(won.into_iter().filter(|won| *won).count(), 1);
}

#[tokio::test]
async fn a_repeated_request_is_answered_with_the_same_event() {
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    let key = |sha: u8| {
        Some(IdempotencyKey {
            key: "k".to_owned(),
            request_sha256: [sha; 32],
        })
    };
    let first = note(&store, event("x"), Actor::service(), key(1))
        .await
        .unwrap();
    let second = note(&store, event("x"), Actor::service(), key(1))
        .await
        .unwrap();
    assert_eq!(
        (first.id, first.repeated, second.repeated),
        (second.id, false, true)
    );
    let refused = note(&store, event("y"), Actor::service(), key(2))
        .await
        .unwrap_err();
    assert!(matches!(refused, StoreError::KeyReused), "{refused}");
    // Without a key, or for another robot, it is another event.
    assert_ne!(
        note(&store, event("x"), Actor::service(), None)
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
        !note(&store, other, Actor::service(), key(1))
            .await
            .unwrap()
            .repeated
    );
    assert_eq!(store.events(&robot("a"), None, 10).await.unwrap().len(), 2);
}

#[tokio::test]
async fn a_note_that_comes_again_through_the_fleet_is_one_event() {
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    note(&store, event("new bracket"), Actor::service(), None)
        .await
        .unwrap();
    let noted = |text: &str| {
        let note = text.to_owned();
        Arc::new(HistoryEvent::Note(RobotEvent {
            kind: NoteKind::Reassembled,
            stamp_ns: RobotTime(5),
            note,
        }))
    };
    for text in ["new bracket", "other", "other", "", ""] {
        Journal::record_event(&store, &robot("a"), &noted(text));
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
async fn events_come_in_pages() {
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    for number in 0..5 {
        note(&store, event(&number.to_string()), Actor::service(), None)
            .await
            .unwrap();
    }
    let first = store.events(&robot("a"), None, 3).await.unwrap();
    let rest = store
        .events(&robot("a"), Some(first[2].id.0), 3)
        .await
        .unwrap();
    let notes: Vec<_> = first
        .iter()
        .chain(&rest)
        .map(|record| record.event.note.clone().unwrap())
        .collect();
    assert_eq!(notes, ["4", "3", "2", "1", "0"]);
}

#[tokio::test]
async fn many_are_registered_all_or_none() {
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    let many = |names: &[&str]| {
        let each = names.iter().map(|name| (robot(name), config(1.2)));
        each.collect::<BTreeMap<_, _>>()
    };
    let register =
        async |names: &[&str]| register_all(&store, &many(names), &Actor::service()).await;
    register(&["b", "c"]).await.unwrap();
    let refused = register(&["a", "b", "d"]).await.unwrap_err();
    assert!(
        matches!(&refused, StoreError::VersionConflict { robot, .. } if robot.as_str() == "b"),
        "{refused}"
    );
    let stored = store.load_robots().await.unwrap();
    let ids: Vec<_> = stored.iter().map(|one| one.id.as_str()).collect();
    assert_eq!(ids, ["b", "c"]);
    let filter = fleetcal_store::AuditFilter {
        limit: 10,
        ..fleetcal_store::AuditFilter::default()
    };
    assert_eq!(store.audit(&filter).await.unwrap().len(), 2);
}

#[tokio::test]
async fn registrations_at_once_never_make_more_robots_than_the_limit() {
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    let named = |numbers: std::ops::Range<usize>| {
        let each = numbers.map(|number| (robot(&format!("r{number}")), config(1.2)));
        each.collect::<BTreeMap<_, _>>()
    };
    let actor = Actor::service();
    let nearly = limits::ROBOTS_MAX - 2;
    for first in (0..nearly).step_by(limits::REGISTERED_AT_ONCE_MAX) {
        let end = nearly.min(first + limits::REGISTERED_AT_ONCE_MAX);
        let registered = register_all(&store, &named(first..end), &actor).await;
        registered.unwrap();
    }
    let (one, other) = (named(nearly..nearly + 2), named(nearly + 2..nearly + 4));
    let (one, other) = tokio::join!(
        register_all(&store, &one, &actor),
        register_all(&store, &other, &actor)
    );
    let full = |refused: &StoreError| matches!(refused, StoreError::RobotsMax { .. });
    assert!(one.is_ok(), "{one:?}");
    assert!(other.as_ref().is_err_and(full), "{other:?}");
    let configured = async |name: &str, expected| {
        configure(&store, &robot(name), &config(1.3), expected, actor.clone()).await
    };
    let refused = configured("new", Expected::Absent).await;
    assert!(refused.as_ref().is_err_and(full), "{refused:?}");
    configured("r0", Expected::Version(Version(1)))
        .await
        .unwrap();
    let stored = store.load_robots().await.unwrap();
    let stored = stored.iter().filter(|robot| robot.config.is_some());
    assert_eq!(stored.count(), limits::ROBOTS_MAX);
}
