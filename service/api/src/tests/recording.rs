//! Live recording of a robot.

use std::time::Duration;

use fleetcal_domain::limits;
use fleetcal_model::{NoteKind, RobotTime, Stream};
use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::event::RobotEvent;
use fleetcal_proto::ros::{AckermannDriveStamped, Log, RosMessage};
use fleetcal_robot::recording::Recording;

use super::access::signed_in;
use super::*;

const URI: &str = "/api/v1/robots/a/recording";

fn drive(stamp_s: i64) -> Vec<u8> {
    let message = serde_json::json!({
        "header": { "stamp": { "sec": stamp_s, "nanosec": 0 }, "frame_id": "base" },
        "drive": { "steering_angle": 0.1, "speed": 1.0 },
    });
    message.to_string().into_bytes()
}

/// Waits for an event, with a timeout.
async fn in_time<T>(what: &str, happening: impl Future<Output = T>) -> T {
    let happened = tokio::time::timeout(Duration::from_secs(30), happening).await;
    happened.unwrap_or_else(|_| panic!("{what}: not within 30 s"))
}

/// Reads a recording to its end.
async fn read(mut session: axum::body::BodyDataStream) -> Vec<u8> {
    let reading = async {
        let mut bytes = Vec::new();
        while let Some(piece) = session.next().await {
            bytes.extend_from_slice(&piece.unwrap());
        }
        bytes
    };
    in_time("the recording's end", reading).await
}

#[tokio::test]
async fn what_came_is_in_the_file_which_ends_with_the_service() {
    let bench = bench(&["a"]).await;
    let session = bench.begin(URI, &[]).await;
    for stamp_s in 1_000..1_010 {
        let payload = drive(stamp_s);
        bench.fleet.receive(
            &robot("a"),
            Stream::WheelOdometry,
            Encoding::Json,
            payload.len(),
            || payload,
        );
    }
    let note = RobotEvent {
        kind: NoteKind::Maintenance,
        stamp_ns: RobotTime(1_005_000_000_000),
        note: "greased".to_owned(),
    };
    let number = fleetcal_model::AuditId(1_000);
    let noted = fleetcal_fleet::Noted {
        number,
        event: note,
    };
    bench.fleet.note(&robot("a"), noted).unwrap();
    let taking = async {
        while bench.fleet.robot(&robot("a")).unwrap().counters.waiting > 0
            || bench.fleet.notes_taken(&robot("a")) < Some(number)
        {
            tokio::task::yield_now().await;
        }
    };
    in_time("the robot's messages are taken", taking).await;
    bench.stop.cancel();
    let bytes = read(session).await;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    std::fs::write(&path, bytes).unwrap();
    let recording = Recording::open(&path).unwrap();
    assert_eq!(recording.count(&["/a/wheel_odometry"]), 10);
    let events = recording.messages(&["/a/events"]).unwrap();
    let events = events.map(|event| Log::from_cdr(&event.unwrap().payload).unwrap());
    let noted = events.filter(|event| event.msg == "maintenance: greased");
    assert_eq!(noted.count(), 1);
    assert_eq!(recording.start_ns(), 1_000_000_000_000);
    let mut drives = recording.messages(&["/a/wheel_odometry"]).unwrap();
    // What came in JSON is kept in CDR, as all of the file.
    let sent = AckermannDriveStamped::from_json(&drive(1_000)).unwrap();
    assert_eq!(drives.next().unwrap().unwrap().payload, sent.to_cdr());
}

#[tokio::test]
async fn recordings_are_limited_and_make_room_when_their_readers_go() {
    let bench = bench(&["a"]).await;
    let mut recordings = Vec::new();
    for _ in 0..limits::RECORDINGS_MAX {
        recordings.push(bench.begin(URI, &[]).await);
    }
    let told = bench.get(URI).await.told();
    assert_eq!(
        told,
        "503 recordings_full: 8 recordings are made already, which is the limit"
    );
    drop(recordings);
    let is_full = async || {
        let request = bench.request("GET", URI, &[], "");
        let response = bench.routes.clone().oneshot(request).await.unwrap();
        response.status() == StatusCode::SERVICE_UNAVAILABLE
    };
    let leaving = async {
        while is_full().await {
            tokio::task::yield_now().await;
        }
    };
    in_time("a place for another", leaving).await;
}

#[tokio::test]
async fn a_recording_ends_when_its_operator_is_made_a_viewer() {
    let bench = bench(&["a"]).await;
    let cookie = signed_in(&bench, Role::Operator).await;
    let headers = [("cookie", cookie.as_str())];
    let session = bench
        .begin(&format!("{URI}?duration_s=3600"), &headers)
        .await;
    let headers = [("if-match", "\"1\"")];
    let role = r#"{"role": "viewer"}"#;
    let edited = bench.send_body("PATCH", "/api/v1/users/1", &headers, role);
    assert_eq!(edited.await.told(), "200");
    // It is whole: that of a robot which has sent nothing.
    let bytes = read(session).await;
    assert!(bytes.ends_with(b"\x89MCAP0\r\n"), "{} bytes", bytes.len());
}

#[tokio::test]
async fn a_robot_without_an_estimator_has_no_recording() {
    let bench = bench(&["a"]).await;
    let told = bench.get("/api/v1/robots/b/recording").await.told();
    assert!(told.starts_with("404 robot_unknown"), "{told}");
    let payload = drive(1_000);
    bench.fleet.receive(
        &robot("b"),
        Stream::WheelOdometry,
        Encoding::Json,
        payload.len(),
        || payload,
    );
    let told = bench.get("/api/v1/robots/b/recording").await.told();
    assert!(told.starts_with("409 robot_unregistered"), "{told}");
    for query in ["duration_s=0", "duration_s=3601", "duration_s=x"] {
        let told = bench.get(&format!("{URI}?{query}")).await.told();
        assert!(told.starts_with("400 value_refused [duration_s]"), "{told}");
    }
}
