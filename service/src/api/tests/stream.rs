//! The event stream.

use fleetcal_proto::event::RobotEventKind;

use super::*;
use crate::limits;

const URI: &str = "/api/v1/stream";

#[tokio::test]
async fn a_listener_is_told_and_the_stream_ends_with_the_service() {
    let bench = bench(&["a", "b"]).await;
    let mut all = bench.begin(URI, &[]).await;
    let mut only_b = bench.begin("/api/v1/stream?robot=b", &[]).await;
    assert_eq!(
        next_event(&mut all).await,
        ("ready".to_owned(), "{}".to_owned())
    );
    assert_eq!(next_event(&mut only_b).await.0, "ready");
    for name in ["a", "b"] {
        let body = r#"{"kind": "maintenance", "note": "greased"}"#;
        let uri = format!("/api/v1/robots/{name}/events");
        assert_eq!(bench.send_body("POST", &uri, &[], body).await.told(), "201");
    }
    let of_event = async |stream: &mut _| loop {
        let (event, data) = next_event(stream).await;
        let data: Value = serde_json::from_str(&data).unwrap();
        // The estimators also say that a session began.
        if event == "event" && data["kind"] == "maintenance" {
            return data;
        }
    };
    let told = of_event(&mut all).await;
    assert_eq!(
        (&told["robot"], &told["note"]),
        (&"a".into(), &"greased".into())
    );
    assert_eq!(of_event(&mut all).await["robot"], "b");
    assert_eq!(of_event(&mut only_b).await["robot"], "b");
    bench.stop.cancel();
    while all.next().await.is_some() {}
}

#[tokio::test]
async fn who_comes_back_is_told_to_read_again() {
    let bench = bench(&[]).await;
    let mut stream = bench.begin(URI, &[("last-event-id", "17")]).await;
    assert_eq!(next_event(&mut stream).await.0, "resync");
}

#[tokio::test]
async fn who_lags_behind_is_told_to_read_again() {
    let bench = bench(&["a"]).await;
    let mut stream = bench.begin(URI, &[]).await;
    assert_eq!(next_event(&mut stream).await.0, "ready");
    let note = fleetcal_proto::event::RobotEvent {
        kind: RobotEventKind::PowerOn,
        stamp_ns: 1,
        note: String::new(),
    };
    let mut told = 0;
    while told < limits::LIVE_UPDATES_MAX + 100 {
        told += usize::from(bench.fleet.note(&robot("a"), &note).is_ok());
        tokio::task::yield_now().await;
    }
    assert_eq!(next_event(&mut stream).await.0, "resync");
}

#[tokio::test]
async fn listeners_are_limited_and_make_room_when_they_go() {
    let bench = bench(&[]).await;
    let mut streams = Vec::new();
    for _ in 0..limits::HTTP_STREAMS_MAX {
        streams.push(bench.begin(URI, &[]).await);
    }
    let told = bench.get(URI).await.told();
    assert_eq!(
        told,
        "503 streams_full: 64 listen already, which is the limit"
    );
    streams.pop();
    drop(bench.begin(URI, &[]).await);
}

#[tokio::test]
async fn a_stream_of_a_robot_that_cannot_be_is_refused() {
    let bench = bench(&[]).await;
    let told = bench.get("/api/v1/stream?robot=a*").await.told();
    assert!(told.starts_with("400 value_refused [robot]"), "{told}");
}
