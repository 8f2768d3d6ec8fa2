//! Hostile robots, and what they must not be able to do to each other.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use fleetcal_proto::ros::{AckermannDriveStamped, RosMessage};
use fleetcal_tests::service::{Service, wait_for};
use tempfile::TempDir;
use zenoh::qos::CongestionControl;

use super::{assert_same, calibrated, recorded, send, sender};

/// Largest payload that is sent to the service, bytes.
const HUGE_BYTES: usize = 64 << 20;
/// Largest growth of the service's memory afterwards, bytes.
const MEMORY_GROWTH_MAX: u64 = 64 << 20;

/// Opens a robot's session, or that of somebody else who can reach the service.
pub(super) async fn client(service: &Service) -> zenoh::Session {
    let mut config = zenoh::Config::default();
    let settings = [
        ("mode", "\"client\"".to_owned()),
        ("connect/endpoints", format!("[{:?}]", service.endpoint())),
        ("connect/timeout_ms", "5000".to_owned()),
        ("scouting/multicast/enabled", "false".to_owned()),
    ];
    for (key, value) in settings {
        config.insert_json5(key, &value).unwrap();
    }
    let open = move || zenoh::Wait::wait(zenoh::open(config));
    tokio::task::spawn_blocking(open).await.unwrap().unwrap()
}

/// Puts a message and waits for room: a message that is missing was refused, not lost on the way.
async fn put(session: &zenoh::Session, key: &str, payload: Vec<u8>) {
    session
        .put(key, payload)
        .congestion_control(CongestionControl::Block)
        .await
        .unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_huge_payload_and_hostile_keys_disturb_nobody() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 60.0);
    let service = Service::start(&["good", "evil"]);
    let memory = service.memory_bytes();
    let good = tokio::spawn(send(sender(&service, &path, "good")));
    let evil = client(&service).await;
    for key in [
        "fleet/*/wheel_odometry",
        "fleet/a$*/wheel_odometry",
        "fleet/**",
        "fleet/rüttler/wheel_odometry",
        "fleet/evil",
    ] {
        put(&evil, key, vec![0; 48]).await;
    }
    let mut lie = AckermannDriveStamped::default();
    lie.header.stamp.sec = 1_700_000_000;
    lie.drive.speed = f32::NAN;
    for _ in 0..100 {
        put(&evil, "fleet/evil/wheel_odometry", lie.to_cdr()).await;
        put(&evil, "fleet/evil/wheel_odometry", b"\0\x01".to_vec()).await;
        put(&evil, "fleet/evil/scan", vec![0xff; 4_000]).await;
    }
    put(&evil, "fleet/evil/scan", vec![0; 2 << 20]).await;
    let counters = wait_for("the refusals", || {
        let counters = service.robot("evil")["counters"].clone();
        (counters["received"] == 301 && counters["waiting"] == 0).then_some(counters)
    });
    assert_eq!(counters["processed"], 0, "{counters}");
    assert!(counters["refused"].as_u64().unwrap() > 200, "{counters}");
    assert!(!counters["last_refusal"].is_null(), "{counters}");
    put(&evil, "fleet/evil/scan", vec![0; HUGE_BYTES]).await;
    let good = good.await.unwrap();
    let estimate = service.estimate_of("good", good.drive_samples);
    assert_same(&estimate, &calibrated(&path));
    assert_eq!(service.accounts_of("good")["refused"], 0);
    service.accounts_of("evil");
    let grown = service.memory_bytes().saturating_sub(memory);
    assert!(grown < MEMORY_GROWTH_MAX, "memory grew by {grown} bytes");
    let robots = service.get("/api/v1/robots");
    assert_eq!(robots["items"].as_array().unwrap().len(), 2, "{robots}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn robots_do_not_hear_each_other() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 5.0);
    let service = Service::start(&["talker"]);
    let eavesdropper = client(&service).await;
    let heard = Arc::new(AtomicU64::new(0));
    let mut ears = Vec::new();
    for key in [
        "fleet/*/wheel_odometry",
        "fleet/talker/scan",
        "fleet/**",
        "**",
    ] {
        let heard = Arc::clone(&heard);
        let ear = eavesdropper
            .declare_subscriber(key)
            .callback(move |sample| {
                // The service's estimates are for everybody.
                if !sample.key_expr().as_str().ends_with("/estimate") {
                    heard.fetch_add(1, Ordering::Relaxed);
                }
            });
        ears.push(ear.await.unwrap());
    }
    let summary = send(sender(&service, &path, "talker")).await;
    service.estimate_of("talker", summary.drive_samples);
    assert_eq!(
        service.accounts_of("talker")["received"],
        summary.drive_samples + summary.scans
    );
    assert_eq!(
        heard.load(Ordering::Relaxed),
        0,
        "another robot's messages were heard"
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn estimates_are_put_and_a_stranger_is_shown() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 20.0);
    let service = Service::start(&["known"]);
    let listener = client(&service).await;
    let (sender_half, mut estimates) = tokio::sync::mpsc::channel(64);
    let subscriber = listener
        .declare_subscriber("fleet/known/estimate")
        .callback(move |sample| {
            drop(sender_half.try_send(sample.payload().to_bytes().into_owned()));
        });
    let subscriber = subscriber.await.unwrap();
    send(sender(&service, &path, "known")).await;
    let put = tokio::time::timeout(Duration::from_secs(10), estimates.recv())
        .await
        .unwrap();
    let document: serde_json::Value = serde_json::from_slice(&put.unwrap()).unwrap();
    assert_eq!(document["robot"], "known");
    subscriber.undeclare().await.unwrap();

    let stranger = send(sender(&service, &path, "stranger")).await;
    assert_eq!(stranger.dropped, stranger.drive_samples + stranger.scans);
    let robot = service.robot("stranger");
    assert_eq!(robot["state"], "unregistered");
    let streams = robot["streams"].as_array().unwrap();
    let names: Vec<_> = streams
        .iter()
        .map(|stream| stream["stream"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["wheel_odometry", "scan"]);
}
