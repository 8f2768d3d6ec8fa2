//! Event stream: its updates, topics and limits.

use std::net::IpAddr;

use fleetcal_domain::limits;
use fleetcal_domain::robot::HistoryEvent;
use fleetcal_fleet::live::LiveUpdate;
use fleetcal_http::PeerAddress;
use fleetcal_model::{NoteKind, RobotTime};

use super::*;

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
        [
            &told["robot"],
            &told["note"],
            &told["source"],
            &told["author"]
        ],
        ["a", "greased", "person", "tester"]
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
        kind: NoteKind::PowerOn,
        stamp_ns: RobotTime(1),
        note: String::new(),
    };
    let event = std::sync::Arc::new(HistoryEvent::Note(note));
    for _ in 0..limits::LIVE_UPDATES_MAX + 100 {
        let (robot, event) = (robot("a"), std::sync::Arc::clone(&event));
        let author = None;
        bench.fleet.announce(LiveUpdate::Event {
            robot,
            event,
            author,
        });
    }
    let (mut event, _) = next_event(&mut stream).await;
    // The writer's first tick may publish the state of the one robot before it reads any update.
    if event == "robot_state" {
        (event, _) = next_event(&mut stream).await;
    }
    assert_eq!(event, "resync");
}

#[tokio::test]
async fn listeners_are_limited_and_make_room_when_they_go() {
    let bench = bench(&[]).await;
    let mut listeners = Vec::new();
    for number in 0..=limits::HTTP_STREAMS_MAX / limits::HTTP_STREAMS_PER_CALLER_MAX {
        let name = format!("wall-{number}");
        let value = token(&bench.store, &name, grant(Role::Viewer), None).await;
        listeners.push(format!("Bearer {value}"));
    }
    // A place of one of them, at one address.
    let listen = async |listener: usize, address: u8| {
        let headers = [("authorization", listeners[listener].as_str())];
        let mut request = bench.request("GET", URI, &headers, "");
        let peer = PeerAddress(Some(IpAddr::from([192, 0, 2, address])));
        request.extensions_mut().insert(peer);
        bench.routes.clone().oneshot(request).await.unwrap()
    };
    let mut streams = Vec::new();
    for number in 0..limits::HTTP_STREAMS_MAX {
        let listener = number / limits::HTTP_STREAMS_PER_CALLER_MAX;
        let address = number / limits::HTTP_STREAMS_PER_ADDRESS_MAX;
        let response = listen(listener, u8::try_from(address).unwrap()).await;
        assert_eq!(response.status().as_u16(), 200, "{number}");
        streams.push(response);
    }
    let last = listeners.len() - 1;
    let refused = |response: axum::response::Response| response.status().as_u16();
    assert_eq!(
        refused(listen(0, 9).await),
        429,
        "the caller has all of its own"
    );
    assert_eq!(
        refused(listen(last, 0).await),
        429,
        "the address has all of its own"
    );
    assert_eq!(refused(listen(last, 9).await), 503, "all are taken");
    streams.pop();
    assert_eq!(refused(listen(last, 9).await), 200);
}

#[tokio::test]
async fn a_stream_of_a_robot_that_cannot_be_is_refused() {
    let bench = bench(&[]).await;
    let told = bench.get("/api/v1/stream?robot=a*").await.told();
    assert!(told.starts_with("400 value_refused [robot]"), "{told}");
}

/// Robots whose estimates move by their own uncertainty, as those of a driving fleet do.
struct Drivers {
    robots: Vec<fleetcal_proto::RobotId>,
    random: rand::rngs::StdRng,
}

impl Drivers {
    fn tell_all(&mut self, bench: &Bench, second: i64) {
        for robot in &self.robots {
            let document = estimate(robot, second, &mut self.random);
            bench
                .fleet
                .announce(fleetcal_fleet::live::LiveUpdate::Estimate {
                    robot: robot.clone(),
                    document: Arc::new(document),
                });
        }
    }
}

/// Estimate with all the parts of a real one, every value a little off the last.
fn estimate(
    robot: &RobotId,
    second: i64,
    random: &mut rand::rngs::StdRng,
) -> fleetcal_proto::estimate::EstimateDocument {
    use rand::Rng;
    let mut parameter = |value: f64, sigma: f64, unit: &str| {
        let off: f64 = random.random_range(-1.0..1.0);
        let sigma = sigma * random.random_range(0.98..1.02);
        serde_json::json!({"value": sigma.mul_add(off, value), "sigma": sigma, "unit": unit,
            "status": "converged", "needs": null})
    };
    serde_json::from_value(serde_json::json!({
        "robot": robot, "stamp_ns": NOW_NS + second * 1_000_000_000,
        "time_s": 100.0 + second as f64, "distance_m": 90.0 + 0.8 * second as f64,
        "parameters": {
            "steering_offset": parameter(0.0213, 0.0001, "rad"),
            "lidar_x": parameter(0.434, 0.001, "m"), "lidar_y": parameter(0.012, 0.001, "m"),
            "lidar_yaw": parameter(0.0087, 0.0002, "rad"),
            "speed_scale": parameter(1.0, 0.001, "1"), "wheelbase": parameter(1.2, 0.0, "m"),
            "time_offset": parameter(0.0, 0.01, "s"), "steering_gain": parameter(1.0, 0.0, "1"),
        },
        "consistency": {"nis_mean": 2.9, "nis_dof": 3.0, "samples": 200},
        "counts": {"drive_samples": 9_000, "scans": 900, "scans_rejected": 0, "late": 0,
            "duplicates": 0},
    }))
    .unwrap()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn with_500_robots_at_1_hz_a_page_receives_what_it_shows() {
    const ROBOTS: usize = 500;
    const SECONDS: i64 = 12;
    const FLEET_MAX: f64 = 50_000.0;
    const OTHER_MAX: f64 = 5_000.0;
    let bench = bench(&[]).await;
    let mut drivers = Drivers {
        robots: (1..=ROBOTS)
            .map(|n| robot(&format!("tugger_{n:03}")))
            .collect(),
        random: rand::SeedableRng::seed_from_u64(17),
    };
    let base = "alerts,approvals,deployments";
    let pages = [
        ("fleet", format!("{URI}?topics=fleet,{base}"), FLEET_MAX),
        (
            "robot",
            format!("{URI}?topics=robot:tugger_001,{base}"),
            OTHER_MAX,
        ),
        ("others", format!("{URI}?topics={base}"), OTHER_MAX),
    ];
    let mut counts = Vec::new();
    for (_, uri, _) in &pages {
        let mut stream = bench.begin(uri, &[("accept-encoding", "gzip")]).await;
        counts.push(tokio::spawn(async move {
            let mut bytes = 0;
            while let Some(Ok(block)) = stream.next().await {
                bytes += block.len();
            }
            bytes
        }));
    }
    for second in 0..SECONDS {
        drivers.tell_all(&bench, second);
        tokio::time::sleep(std::time::Duration::from_secs(1)).await;
    }
    bench.stop.cancel();
    for ((page, _, most), count) in pages.iter().zip(counts) {
        let per_second = count.await.unwrap() as f64 / SECONDS as f64;
        println!(
            "{page}: {:.1} kB/s of {ROBOTS} robots at 1 Hz",
            per_second / 1e3
        );
        assert!(per_second <= *most, "{page}: {per_second} B/s");
    }
}

#[tokio::test]
async fn a_fleets_rows_are_lean_and_told_when_they_change() {
    let bench = bench(&[]).await;
    let mut stream = bench.begin("/api/v1/stream?topics=fleet", &[]).await;
    assert_eq!(next_event(&mut stream).await.0, "ready");
    let mut random = rand::SeedableRng::seed_from_u64(1);
    let document = Arc::new(estimate(&robot("a"), 1, &mut random));
    let tell = || {
        bench
            .fleet
            .announce(fleetcal_fleet::live::LiveUpdate::Estimate {
                robot: robot("a"),
                document: Arc::clone(&document),
            });
    };
    tell();
    let (event, data) = next_event(&mut stream).await;
    assert_eq!(event, "rows");
    let rows: Value = serde_json::from_str(&data).unwrap();
    assert_eq!(rows[0]["robot"], "a");
    assert_eq!(rows[0]["status"][3], "converged");
    assert!(data.len() < 250, "{data}");
    // The same again is no news: the next that is told is the policy.
    tell();
    tokio::time::sleep(std::time::Duration::from_millis(1_200)).await;
    tell();
    bench
        .fleet
        .announce(fleetcal_fleet::live::LiveUpdate::Policy);
    let next = tokio::time::timeout(
        std::time::Duration::from_millis(1_500),
        next_event(&mut stream),
    );
    assert!(
        next.await.is_err(),
        "neither the same row nor what was not asked for"
    );
}

#[tokio::test]
async fn the_freeze_and_the_policy_have_events_of_their_own() {
    let bench = bench(&[]).await;
    let mut stream = bench.begin("/api/v1/stream?topics=deployments", &[]).await;
    assert_eq!(next_event(&mut stream).await.0, "ready");
    for (uri, body, event) in [
        (
            "/api/v1/deployments/freeze",
            r#"{"frozen": true, "reason": "audit"}"#,
            "freeze",
        ),
        (
            "/api/v1/policy",
            r#"{"policy": null, "reason": "as before"}"#,
            "policy",
        ),
    ] {
        let etag = bench.get(uri).await.header("etag").to_owned();
        let headers = [("if-match", etag.as_str())];
        assert_eq!(
            bench.send_body("PUT", uri, &headers, body).await.told(),
            "200"
        );
        assert_eq!(next_event(&mut stream).await.0, event);
    }
}

#[tokio::test]
async fn an_unknown_topic_is_refused() {
    let bench = bench(&[]).await;
    let told = bench
        .get("/api/v1/stream?topics=fleet,everything")
        .await
        .told();
    assert!(told.starts_with("400 value_refused [topics]"), "{told}");
    let told = bench
        .get("/api/v1/stream?topics=fleet&robot=a")
        .await
        .told();
    assert!(told.starts_with("400 value_refused [topics]"), "{told}");
}
