//! Moments of a robot.

use std::time::Duration;

use fleetcal_domain::limits;
use fleetcal_model::{NoteKind, Stream};
use fleetcal_proto::encoding::Encoding;
use fleetcal_robot::recording::Recording;

use super::*;

const URI: &str = "/api/v1/robots/a/moments";

/// Sends a drive sample of the robot, which its task takes.
async fn send(bench: &Bench, stamp_s: i64) {
    let message = serde_json::json!({
        "header": { "stamp": { "sec": stamp_s, "nanosec": 0 }, "frame_id": "base" },
        "drive": { "steering_angle": 0.1, "speed": 1.0 },
    });
    let payload = message.to_string().into_bytes();
    let before = bench.fleet.latest_data(&robot("a")).unwrap();
    let length = payload.len();
    let taken = || payload;
    bench.fleet.receive(
        &robot("a"),
        Stream::WheelOdometry,
        Encoding::Json,
        length,
        taken,
    );
    let count = before.messages().count();
    while bench
        .fleet
        .latest_data(&robot("a"))
        .unwrap()
        .messages()
        .count()
        == count
    {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

#[tokio::test]
async fn a_moment_is_kept_on_request_and_downloaded() {
    let bench = bench(&["a"]).await;
    let told = bench.send_body("POST", URI, &[], "").await.told();
    assert_eq!(
        told,
        "409 robot_silent: robot a has sent nothing within the last 60 s"
    );
    for stamp_s in 1_000..1_010 {
        send(&bench, stamp_s).await;
    }
    let uri = format!("{URI}?note=odd%20noise");
    let kept = bench.send_body("POST", &uri, &[], "").await;
    assert_eq!(kept.told(), "201");
    let kept = kept.json();
    assert_eq!(kept["kind"], "requested");
    assert_eq!(kept["note"], "odd noise");
    assert_eq!(kept["messages"], 10);
    assert_eq!(kept["from"], "1970-01-01T00:16:40Z");
    assert_eq!(kept["to"], "1970-01-01T00:16:49Z");
    let listed = bench.get(URI).await.json();
    assert_eq!(listed["moments"], serde_json::json!([kept]));
    assert_eq!(
        (&listed["dropped"], &listed["lost"]),
        (&0.into(), &0.into())
    );

    let uri = format!("{URI}/{}", kept["id"]);
    let mut pieces = bench.begin(&uri, &[]).await;
    let mut bytes = Vec::new();
    while let Some(piece) = pieces.next().await {
        bytes.extend_from_slice(&piece.unwrap());
    }
    assert_eq!(kept["bytes"], bytes.len());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    std::fs::write(&path, bytes).unwrap();
    let recording = Recording::open(&path).unwrap();
    assert_eq!(recording.count(&["/a/wheel_odometry"]), 10);
    for missing in ["0", "x"] {
        let told = bench.get(&format!("{URI}/{missing}")).await.told();
        assert!(told.starts_with("404 moment_unknown"), "{told}");
    }
    for uri in ["/api/v1/robots/b/moments", "/api/v1/robots/b/moments/1"] {
        let told = bench.get(uri).await.told();
        assert!(told.starts_with("404 "), "{told}");
    }
}

#[tokio::test]
async fn a_reported_reassembly_keeps_the_data_before_it() {
    let bench = bench(&["a"]).await;
    send(&bench, 1_000).await;
    let body = r#"{"kind": "reassembled", "note": "bracket replaced"}"#;
    let uri = "/api/v1/robots/a/events";
    assert_eq!(bench.send_body("POST", uri, &[], body).await.told(), "201");
    let waiting = async {
        loop {
            let listed = bench.get(URI).await.json();
            if let Some(moment) = listed["moments"].get(0) {
                return moment.clone();
            }
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    let moment = tokio::time::timeout(Duration::from_secs(30), waiting).await;
    let moment = moment.unwrap();
    assert_eq!(moment["kind"], serde_json::json!(NoteKind::Reassembled));
    assert_eq!(moment["note"], "bracket replaced");
    assert_eq!(moment["messages"], 1);
}

#[tokio::test]
async fn downloads_of_moments_and_bundles_take_places_of_files() {
    let bench = bench(&["a"]).await;
    send(&bench, 1_000).await;
    let kept = bench.send_body("POST", URI, &[], "").await.json();
    let uri = format!("{URI}/{}", kept["id"]);
    let bundle = "/api/v1/robots/a/support";
    assert_eq!(bench.get(bundle).await.told(), "200");
    // So long that it is not sent before somebody reads it.
    let file = format!("moments/a/{}.mcap", kept["id"]);
    std::fs::write(bench.data.path().join(file), vec![0; 1 << 20]).unwrap();
    let mut open = Vec::new();
    for _ in 0..limits::EXPORTS_PER_CALLER_MAX {
        open.push(bench.begin(&uri, &[]).await);
    }
    for uri in [&uri, bundle] {
        let told = bench.get(uri).await.told();
        assert!(told.starts_with("429 exports_of_caller"), "{uri}: {told}");
    }
    let listed = bench.get(&format!("{bundle}?list=true")).await;
    let listed = listed.json();
    let file = serde_json::json!({
        "name": format!("moments/{}.mcap", kept["id"]),
        "bytes": kept["bytes"],
    });
    assert!(
        listed["files"].as_array().unwrap().contains(&file),
        "{listed}"
    );
    open.clear();
    // Each writing task frees its place when it sees that its reader is gone, at its next turn.
    tokio::task::yield_now().await;
    for uri in [&uri, bundle] {
        assert_eq!(bench.get(uri).await.told(), "200");
    }
}
