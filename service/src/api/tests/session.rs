//! A robot's session as it is recorded.

use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::event::{RobotEvent, RobotEventKind};
use fleetcal_robot::recording::Recording;

use super::*;
use crate::fleet::Stream;
use crate::limits;

const URI: &str = "/api/v1/robots/a/session";

fn drive(stamp_s: i64) -> Vec<u8> {
    let message = serde_json::json!({
        "header": { "stamp": { "sec": stamp_s, "nanosec": 0 }, "frame_id": "base" },
        "drive": { "steering_angle": 0.1, "speed": 1.0 },
    });
    message.to_string().into_bytes()
}

#[tokio::test]
async fn what_came_is_in_the_file_which_ends_with_the_service() {
    let bench = bench(&["a"]).await;
    let mut session = bench.begin(URI, &[]).await;
    for stamp_s in 1_000..1_010 {
        let payload = drive(stamp_s);
        bench.fleet.receive(
            &robot("a"),
            Stream::Drive,
            Encoding::Json,
            payload.len(),
            || payload,
        );
    }
    let note = RobotEvent {
        kind: RobotEventKind::Maintenance,
        stamp_ns: 1_005_000_000_000,
        note: "greased".to_owned(),
    };
    bench.fleet.note(&robot("a"), &note).unwrap();
    while bench.fleet.robot(&robot("a")).unwrap().counters.waiting > 0 {
        tokio::task::yield_now().await;
    }
    bench.stop.cancel();
    let mut bytes = Vec::new();
    while let Some(piece) = session.next().await {
        bytes.extend_from_slice(&piece.unwrap());
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    std::fs::write(&path, bytes).unwrap();
    let recording = Recording::open(&path).unwrap();
    assert_eq!(recording.count(&["/a/drive"]), 10);
    let events = recording.messages(&["/a/events"]).unwrap();
    let events = events.map(|event| String::from_utf8(event.unwrap().payload).unwrap());
    let noted = events.filter(|event| event.contains("maintenance: greased"));
    assert_eq!(noted.count(), 1);
    assert_eq!(recording.start_ns(), 1_000_000_000_000);
    let mut drives = recording.messages(&["/a/drive"]).unwrap();
    assert_eq!(drives.next().unwrap().unwrap().payload, drive(1_000));
}

#[tokio::test]
async fn sessions_are_limited_and_make_room_when_their_readers_go() {
    let bench = bench(&["a"]).await;
    let mut sessions = Vec::new();
    for _ in 0..limits::SESSIONS_MAX {
        sessions.push(bench.begin(URI, &[]).await);
    }
    let told = bench.get(URI).await.told();
    assert_eq!(
        told,
        "503 sessions_full: 8 sessions are recorded already, which is the limit"
    );
    drop(sessions);
    let is_full = async || {
        let request = bench.request("GET", URI, &[], "");
        let response = bench.routes.clone().oneshot(request).await.unwrap();
        response.status() == StatusCode::SERVICE_UNAVAILABLE
    };
    while is_full().await {
        tokio::task::yield_now().await;
    }
}

#[tokio::test]
async fn a_robot_without_an_estimator_has_no_session() {
    let bench = bench(&["a"]).await;
    let told = bench.get("/api/v1/robots/b/session").await.told();
    assert!(told.starts_with("404 robot_unknown"), "{told}");
    let payload = drive(1_000);
    bench.fleet.receive(
        &robot("b"),
        Stream::Drive,
        Encoding::Json,
        payload.len(),
        || payload,
    );
    let told = bench.get("/api/v1/robots/b/session").await.told();
    assert!(told.starts_with("409 robot_unregistered"), "{told}");
    for query in ["duration_s=0", "duration_s=3601", "duration_s=x"] {
        let told = bench.get(&format!("{URI}?{query}")).await.told();
        assert!(told.starts_with("400 value_refused [duration_s]"), "{told}");
    }
}
