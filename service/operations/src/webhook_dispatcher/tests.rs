//! Receivers on the loopback, with the faults of real ones.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use fleetcal_clock::{Clock, MockClock};
use fleetcal_contract::TestDatabase;
use fleetcal_domain::access::Actor;
use fleetcal_domain::alert::{AlertKind, AlertPolicy, Observation, Sighting};
use fleetcal_domain::webhook::{Delivery, Secret, WebhookEvent, WebhookUrl};
use fleetcal_model::{WallTime, WebhookId};
use fleetcal_proto::RobotId;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

use super::*;
use crate::alert_evaluator::Observe;

/// Time 2026-01-01T00:00:00Z.
const NOW_NS: i64 = 1_767_225_600_000_000_000;
/// Timeout beyond any duration of these tests.
const PATIENCE: Duration = Duration::from_mins(1);

fn secret() -> Secret {
    Secret::from_bytes(vec![9; 32])
}

/// Store with a webhook for each address.
struct Bench {
    database: TestDatabase,
    clock: Arc<MockClock>,
    store: Store,
}

impl Bench {
    async fn new(urls: &[String]) -> Self {
        let database = TestDatabase::new().await;
        let clock = MockClock::at(NOW_NS);
        let store = database.open(clock.clone()).await;
        for url in urls {
            let write = CreateWebhook {
                url: WebhookUrl::parse(url).unwrap(),
                events: WebhookEvent::ALL.to_vec(),
                secret: secret(),
                actor: Actor::service(),
                now: WallTime(NOW_NS),
            };
            store.transact(write).await.unwrap();
        }
        Self {
            database,
            clock,
            store,
        }
    }

    /// Begins an alert about a robot, which every webhook receives.
    async fn alert(&self, robot: &str) {
        let sighting = Sighting {
            kind: AlertKind::NotApplied,
            observation: Observation::Firing,
            what: "refused".to_owned(),
            robots: Vec::new(),
        };
        let write = Observe {
            sightings: vec![(RobotId::parse(robot).unwrap().into(), sighting)],
            policy: Arc::new(AlertPolicy::default()),
            standing: BTreeMap::new(),
            evaluator: None,
            now: self.clock.now(),
        };
        self.store.transact(write).await.unwrap();
    }

    fn dispatcher(&self) -> WebhookDispatcher {
        WebhookDispatcher::start(WebhookDispatcherSetup {
            store: self.store.clone(),
            clock: self.clock.clone(),
            jitter: || Ok(0.0),
            membership: fleetcal_cluster::Membership::alone(),
        })
    }

    /// Newest message of a webhook, once it satisfies a condition.
    async fn delivery(&self, webhook: WebhookId, is_ready: impl Fn(&Delivery) -> bool) -> Delivery {
        let wait = async {
            loop {
                let log = self.store.deliveries(webhook, None, 1).await.unwrap();
                if let Some(found) = log.into_iter().next().filter(&is_ready) {
                    return found;
                }
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        };
        tokio::time::timeout(PATIENCE, wait).await.unwrap()
    }
}

async fn listen() -> (TcpListener, String) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("http://{}/hook?a=b", listener.local_addr().unwrap());
    (listener, url)
}

/// Received request: its head and body.
struct Received {
    head: String,
    body: String,
}

impl Received {
    fn header(&self, name: &str) -> &str {
        let lines = self.head.lines().filter_map(|line| line.split_once(": "));
        let mut values = lines.filter(|(found, _)| found.eq_ignore_ascii_case(name));
        values.next().map_or("", |(_, value)| value)
    }
}

/// Reads one request, and answers it with these bytes; if they are empty, the connection just ends.
async fn answer(listener: &TcpListener, answer: &str) -> Received {
    let accepted = tokio::time::timeout(PATIENCE, listener.accept()).await;
    let (mut stream, _) = accepted.unwrap().unwrap();
    let received = read(&mut stream).await;
    stream.write_all(answer.as_bytes()).await.unwrap();
    received
}

async fn read(stream: &mut TcpStream) -> Received {
    let mut bytes = Vec::new();
    loop {
        let mut chunk = [0; 4_096];
        let count = stream.read(&mut chunk).await.unwrap();
        assert!(count > 0, "the request ended early");
        bytes.extend_from_slice(&chunk[..count]);
        let text = String::from_utf8_lossy(&bytes);
        let Some((head, body)) = text.split_once("\r\n\r\n") else {
            continue;
        };
        let received = Received {
            head: head.to_owned(),
            body: body.to_owned(),
        };
        if received.header("content-length").parse() == Ok(received.body.len()) {
            return received;
        }
    }
}

const OK: &str = "HTTP/1.1 204 No Content\r\n\r\n";

#[tokio::test]
async fn a_message_is_signed_and_sent_again_until_it_is_taken() {
    let (listener, url) = listen().await;
    let bench = Bench::new(&[url]).await;
    bench.alert("tugger_01").await;
    let dispatcher = bench.dispatcher();
    let mut ids = Vec::new();
    for (number, said) in [
        "HTTP/1.1 500 Internal Server Error\r\ncontent-length: 0\r\n\r\n",
        "",
        OK,
    ]
    .into_iter()
    .enumerate()
    {
        let received = answer(&listener, said).await;
        assert!(received.head.starts_with("POST /hook?a=b HTTP/1.1\r\n"));
        assert_eq!(received.header("content-type"), "application/json");
        let (id, stamp) = (
            received.header("webhook-id"),
            received.header("webhook-timestamp"),
        );
        let sent_s: i64 = stamp.parse().unwrap();
        assert_eq!(sent_s, bench.clock.now().whole_s());
        let signature = secret().sign(id, sent_s, &received.body);
        assert_eq!(received.header("webhook-signature"), signature);
        let body: serde_json::Value = serde_json::from_str(&received.body).unwrap();
        assert_eq!(body["type"], "alert.alerting");
        assert_eq!(body["timestamp"], "2026-01-01T00:00:00Z");
        assert_eq!(body["data"]["robot"], "tugger_01");
        assert_eq!(body["data"]["state"], "alerting");
        ids.push(id.to_owned());
        let made = |one: &Delivery| one.attempts_made as usize == number + 1;
        bench.delivery(WebhookId(1), made).await;
        // 5 s after the first attempt, 10 s after the second.
        bench.clock.advance(Duration::from_secs(10));
    }
    assert!(ids.iter().all(|id| *id == ids[0]), "{ids:?}");
    let log = bench.delivery(WebhookId(1), |_| true).await;
    assert_eq!(log.state, DeliveryState::Delivered);
    let statuses: Vec<_> = log.attempts.iter().map(|one| one.status).collect();
    assert_eq!(statuses, [Some(500), None, Some(204)]);
    assert!(log.attempts[1].error.is_some());
    let counters = WebhookDispatcherCounters {
        delivered: 1,
        failed_attempts: 2,
        given_up: 0,
    };
    // They are counted after they are written down.
    let counted = async {
        while dispatcher.counters() != counters {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::time::timeout(PATIENCE, counted).await.unwrap();
    dispatcher.stop().await;
}

#[tokio::test]
async fn what_was_committed_before_a_stop_is_sent_after_the_next_start() {
    let (listener, url) = listen().await;
    let bench = Bench::new(&[url]).await;
    bench.alert("a").await;
    bench.store.close().await.unwrap();
    let Bench {
        database,
        clock,
        store,
    } = bench;
    drop(store);
    let store = database.open(clock.clone()).await;
    let bench = Bench {
        database,
        clock,
        store,
    };
    let dispatcher = bench.dispatcher();
    let received = answer(&listener, OK).await;
    assert!(received.body.contains("\"robot\":\"a\""));
    bench
        .delivery(WebhookId(1), |one| one.state == DeliveryState::Delivered)
        .await;
    dispatcher.stop().await;
}

#[tokio::test]
async fn a_redirection_is_not_followed() {
    let (elsewhere, there) = listen().await;
    let (listener, url) = listen().await;
    let bench = Bench::new(&[url]).await;
    bench.alert("a").await;
    let dispatcher = bench.dispatcher();
    let moved = format!("HTTP/1.1 307 Moved\r\nlocation: {there}\r\ncontent-length: 0\r\n\r\n");
    answer(&listener, &moved).await;
    let tried = bench
        .delivery(WebhookId(1), |one| one.attempts_made == 1)
        .await;
    assert_eq!(tried.attempts[0].status, Some(307));
    assert_eq!(tried.state, DeliveryState::Waiting);
    let followed = tokio::time::timeout(Duration::from_millis(200), elsewhere.accept());
    assert!(followed.await.is_err(), "somebody came");
    dispatcher.stop().await;
}

#[tokio::test]
async fn a_receiver_that_never_answers_keeps_nobody_else_waiting() {
    let (silent, silent_url) = listen().await;
    let (good, good_url) = listen().await;
    let bench = Bench::new(&[silent_url, good_url]).await;
    bench.alert("a").await;
    bench.alert("b").await;
    let dispatcher = bench.dispatcher();
    let (_held, _) = silent.accept().await.unwrap();
    for _ in 0..2 {
        answer(&good, OK).await;
    }
    bench
        .delivery(WebhookId(2), |one| one.state == DeliveryState::Delivered)
        .await;
    let waits = bench.delivery(WebhookId(1), |_| true).await;
    assert_eq!(waits.attempts_made, 0);
    // Nor the service's end.
    let stopped = tokio::time::timeout(Duration::from_secs(5), dispatcher.stop());
    stopped.await.unwrap();
}

#[tokio::test]
async fn https_is_spoken_and_an_untrusted_receiver_is_told_nothing() {
    let (listener, url) = listen().await;
    let bench = Bench::new(&[url.replace("http:", "https:")]).await;
    bench.alert("a").await;
    let dispatcher = bench.dispatcher();
    let (mut stream, _) = listener.accept().await.unwrap();
    let mut first = [0; 3];
    stream.read_exact(&mut first).await.unwrap();
    // A TLS handshake record, of TLS 1.x.
    assert_eq!(first[..2], [0x16, 0x03]);
    stream.write_all(OK.as_bytes()).await.unwrap();
    let tried = bench
        .delivery(WebhookId(1), |one| one.attempts_made == 1)
        .await;
    let attempt = &tried.attempts[0];
    assert_eq!(attempt.status, None);
    assert!(attempt.error.is_some(), "{attempt:?}");
    dispatcher.stop().await;
}
