//! Replays over a real Zenoh router, into a mailbox of the service's size.

mod service;

use std::path::PathBuf;
use std::sync::atomic::Ordering;

use fleetcal_ports::free_address;
use fleetcal_proto::ros::{AckermannDriveStamped, Header, LaserScan, Time};
use service::Service;
use tempfile::TempDir;

use super::*;
use crate::recording::RecordingWriter;

const START_NS: i64 = 1_700_000_000_000_000_000;

/// Makes a recording of drive samples at 100 Hz and scans at 10 Hz.
fn recorded(folder: &TempDir, seconds: i64) -> PathBuf {
    let path = folder.path().join("a.mcap");
    let mut writer = RecordingWriter::create(&path, &RobotId::parse("tugger_01").unwrap()).unwrap();
    for step in 0..seconds * 100 {
        let stamp = Time::from_ns(START_NS + step * 10_000_000).unwrap();
        let header = Header {
            stamp,
            frame_id: "base".into(),
        };
        let drive = AckermannDriveStamped {
            header: header.clone(),
            ..Default::default()
        };
        writer.wheel_odometry(&drive).unwrap();
        if step % 10 == 5 {
            writer
                .scan(&LaserScan {
                    header,
                    angle_min: 0.0,
                    angle_max: 6.0,
                    angle_increment: 6.0 / 1023.0,
                    time_increment: 0.0,
                    scan_time: 0.1,
                    range_min: 0.1,
                    range_max: 30.0,
                    ranges: [5.0; 1024].into(),
                    intensities: [].into(),
                })
                .unwrap();
        }
    }
    writer.finish().unwrap();
    path
}

fn options(recording: PathBuf, service: &Service) -> ReplayOptions {
    let mut options = ReplayOptions::new(recording, vec![service.endpoint.clone()]);
    options.rate = Rate::Max;
    options.stall_timeout = Duration::from_secs(10);
    options
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_paced_sender_loses_nothing_at_any_speed() {
    let folder = TempDir::new().unwrap();
    let service = Service::start(Duration::from_micros(300)).await;
    let mut seen = Vec::new();
    let options = options(recorded(&folder, 60), &service);
    let summary = replay(options, |progress| seen.push(progress))
        .await
        .unwrap();
    assert_eq!(summary.robot.as_str(), "tugger_01");
    assert_eq!(
        (summary.drive_samples, summary.scans, summary.dropped),
        (6000, 600, 0)
    );
    assert_eq!(seen.len(), 6600);
    let last = ReplayProgress {
        sent: 6600,
        total: 6600,
        recording_ms: 59_990,
    };
    assert_eq!(seen.last(), Some(&last));

    let seen = service.seen();
    assert!(
        seen.stamps_ns.is_sorted(),
        "the two streams came out of their order"
    );
    assert_eq!(seen.stamps_ns.len(), 6600);
    assert_eq!(seen.encodings, ["application/cdr"]);
    assert!(
        seen.waiting_max[0] <= 512 && seen.waiting_max[1] <= 4,
        "{:?}",
        seen.waiting_max
    );
    // A window that is never filled would prove nothing.
    assert_eq!(seen.waiting_max[1], 4);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_token_stands_until_the_last_message_was_worked_through() {
    let folder = TempDir::new().unwrap();
    let service = Service::start(Duration::from_millis(2)).await;
    let options = options(recorded(&folder, 3), &service);
    replay(options, |_| ()).await.unwrap();
    service.wait_until_gone().await;
    let seen = service.seen();
    assert_eq!(
        seen.token,
        [
            "put fleet/@alive/tugger_01",
            "delete fleet/@alive/tugger_01"
        ]
    );
    assert_eq!(seen.done_when_token_went, 330);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_sender_that_does_not_pace_itself_is_shed_and_told() {
    let folder = TempDir::new().unwrap();
    let service = Service::start(Duration::from_millis(2)).await;
    let mut options = options(recorded(&folder, 20), &service);
    options.pacing = Pacing::Unpaced;
    options.robot = Some(RobotId::parse("other").unwrap());
    let summary = replay(options, |_| ()).await.unwrap();
    assert_eq!((summary.drive_samples, summary.scans), (2000, 200));
    let seen = service.seen();
    assert!(
        summary.dropped > 100,
        "only {} were dropped",
        summary.dropped
    );
    assert_eq!(summary.dropped + seen.stamps_ns.len() as u64, 2200);
    assert!(
        seen.keys.iter().all(|key| key.starts_with("fleet/other/")),
        "{:?}",
        seen.keys
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_service_that_forgets_its_counts_does_not_stop_a_replay() {
    let folder = TempDir::new().unwrap();
    let service = Service::start(Duration::from_micros(500)).await;
    let options = options(recorded(&folder, 20), &service);
    let forget = std::sync::Arc::clone(&service.forget);
    let summary = replay(options, |progress| {
        if progress.sent == 1100 {
            forget.store(true, Ordering::SeqCst);
        }
    });
    let summary = summary.await.unwrap();
    assert_eq!(
        (summary.drive_samples, summary.scans, summary.dropped),
        (2000, 200, 0)
    );
    assert!(
        !service.forget.load(Ordering::SeqCst),
        "the counts were never forgotten"
    );
    assert!(service.seen().waiting_max[1] <= 8);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_service_that_dies_and_comes_back_is_waited_for() {
    let folder = TempDir::new().unwrap();
    let first = Service::start(Duration::from_millis(1)).await;
    let endpoint = first.endpoint.clone();
    let options = options(recorded(&folder, 30), &first);
    let (told, mut half) = tokio::sync::mpsc::channel(1);
    let running = tokio::spawn(replay(options, move |progress| {
        if progress.sent == 1650 {
            told.try_send(()).unwrap();
        }
    }));
    half.recv().await.unwrap();
    first.stop().await;
    let before = first.seen().stamps_ns;
    drop(first);

    let second = Service::start_at(endpoint, Duration::from_millis(1)).await;
    let summary = running.await.unwrap().unwrap();
    assert_eq!(
        (summary.drive_samples, summary.scans, summary.dropped),
        (3000, 300, 0)
    );
    let after = second.seen().stamps_ns;
    assert!(
        before.len() > 1000 && after.len() > 1000,
        "{} {}",
        before.len(),
        after.len()
    );
    assert!(after.is_sorted());
    // No more is lost than what was on the way.
    let lost = 3300 - before.len() - after.len();
    assert!(lost <= 516, "{lost} were lost");
    assert!(
        summary.unconfirmed >= lost as u64,
        "{} of {lost}",
        summary.unconfirmed
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_rate_is_kept() {
    let folder = TempDir::new().unwrap();
    let service = Service::start(Duration::ZERO).await;
    let mut options = options(recorded(&folder, 5), &service);
    options.rate = Rate::Times(10.0);
    let summary = replay(options, |_| ()).await.unwrap();
    assert!(
        summary.duration >= Duration::from_millis(499),
        "{:?}",
        summary.duration
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_service_that_stops_is_told_apart_from_one_that_is_silent() {
    let folder = TempDir::new().unwrap();
    let service = Service::start(Duration::from_hours(1)).await;
    let mut options = options(recorded(&folder, 10), &service);
    options.stall_timeout = Duration::from_millis(300);
    let error = replay(options.clone(), |_| ()).await.unwrap_err();
    let sentence = error.to_string();
    assert!(
        sentence.contains("has not moved on with tugger_01 for 0.3 s"),
        "{sentence}"
    );
    assert_eq!(error.exit_status(), 74);

    service.silence().await;
    let sentence = replay(options, |_| ()).await.unwrap_err().to_string();
    assert!(
        sentence.contains("says nothing of its progress with tugger_01"),
        "{sentence}"
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nobody_there_and_nobody_listening_are_said() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 1);
    let (_router, endpoint) = service::router().await;
    let mut options = ReplayOptions::new(path, vec![endpoint]);
    options.connect_timeout = Duration::from_millis(300);
    let sentence = replay(options.clone(), |_| ())
        .await
        .unwrap_err()
        .to_string();
    assert!(
        sentence.contains("nobody listens to fleet/tugger_01/wheel_odometry after 0.3 s"),
        "{sentence}"
    );

    options.connect = vec![format!("tcp/{}", free_address())].into();
    let error = replay(options.clone(), |_| ()).await.unwrap_err();
    assert!(
        error
            .to_string()
            .starts_with("no Zenoh router answers at tcp/"),
        "{error}"
    );
    assert_eq!(error.exit_status(), 74);

    options.connect = vec!["7447".to_owned()].into();
    let error = replay(options, |_| ()).await.unwrap_err();
    assert!(
        error
            .to_string()
            .starts_with("connect/endpoints is [\"7447\"]"),
        "{error}"
    );
    assert_eq!(error.exit_status(), 2);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_truncated_recording_is_refused_before_anything_is_sent() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 5);
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let options = ReplayOptions::new(path, vec!["tcp/127.0.0.1:1".into()]);
    let error = replay(options, |_| ()).await.unwrap_err();
    assert!(error.to_string().contains("truncated"), "{error}");
    assert_eq!(error.exit_status(), 65);
}
