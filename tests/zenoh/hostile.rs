//! Hostile sessions of anybody who reaches the port.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use serde_json::{Value, json};
use tokio::task::JoinSet;
use tokio::time::Instant;
use zenoh::Session;
use zenoh::qos::CongestionControl;

use super::flood_kinds::KINDS;
use super::{Place, say};

/// Tokens that every robot may query.
const SERVICES: &str = "fleet/@service/*";
/// Id of the attacked robot.
const ATTACKED: &str = "robot_50";
/// Declarations that a session keeps; it undeclares the oldest beyond.
const KEPT_MAX: usize = 20_000;
/// Actions between two readings of the clock.
const AT_ONCE: u64 = 16;

/// Attacks from `count` sessions, one process, in one way or (`all`) each in another.
pub async fn sessions(place: &Place, duration: Duration, count: usize, kind: &str) {
    let mut opened = Vec::new();
    for number in 0..count {
        opened.push(place.connect(number, ATTACKED).await);
    }
    say(&json!({ "ready": opened.len() }));
    let end = Instant::now() + duration;
    let done = Arc::new(AtomicU64::new(0));
    let mut attacks = JoinSet::new();
    for (number, session) in opened.into_iter().enumerate() {
        let kind = match kind {
            "all" => KINDS[number % KINDS.len()],
            one => KINDS.into_iter().find(|kind| *kind == one).unwrap(),
        };
        let done = Arc::clone(&done);
        attacks.spawn(async move { attack(&session, kind, number, end, &done).await });
    }
    // A session that the service has closed, or one that hangs, does not keep the process.
    let grace = end + Duration::from_secs(5);
    while let Ok(Some(ended)) = tokio::time::timeout_at(grace, attacks.join_next()).await {
        ended.unwrap();
    }
    say(&json!({ "done": done.load(Ordering::Relaxed) }));
    std::process::exit(0);
}

async fn attack(session: &Session, kind: &str, number: usize, end: Instant, done: &AtomicU64) {
    let (mut at, robot) = (0_u64, ATTACKED);
    match kind {
        "tokens" => {
            let mut kept = std::collections::VecDeque::new();
            while Instant::now() < end {
                let key = format!("fleet/@alive/x{number}_{at}");
                let declared = session.liveliness().declare_token(key).await;
                keep(&mut kept, declared);
                tick(&mut at, done).await;
            }
        }
        "subscribers" => {
            let mut kept = std::collections::VecDeque::new();
            while Instant::now() < end {
                let key = format!("fleet/{robot}_{number}_{at}/estimate");
                let declared = session.declare_subscriber(key).callback(|_| {}).await;
                keep(&mut kept, declared);
                tick(&mut at, done).await;
            }
        }
        "queryables" => {
            let mut kept = std::collections::VecDeque::new();
            while Instant::now() < end {
                let key = format!("fleet/{robot}_{number}_{at}/progress");
                let declared = session.declare_queryable(key).callback(|_| {}).await;
                keep(&mut kept, declared);
                tick(&mut at, done).await;
            }
        }
        "queries" => {
            while Instant::now() < end {
                for key in ["progress", "calibration/approved", "calibration/confirmed"] {
                    let asked = session.get(format!("fleet/{robot}/{key}"));
                    drop(asked.callback(|_| {}).await);
                }
                tick(&mut at, done).await;
            }
        }
        "liveliness_queries" | "liveliness_subscribers" => {
            ask_for_services(session, kind, end, done).await;
        }
        "notes" => {
            let key = format!("fleet/{robot}/event");
            while Instant::now() < end {
                put(session, &key, &note(at)).await;
                tick(&mut at, done).await;
            }
        }
        "answers" => {
            let key = format!("fleet/{robot}/calibration/applied");
            while Instant::now() < end {
                put(session, &key, &forged(at)).await;
                tick(&mut at, done).await;
            }
        }
        other => unreachable!("{other}"),
    }
}

/// Queries the services' tokens: with a query each time, or with a subscriber that receives
/// changes.
async fn ask_for_services(session: &Session, kind: &str, end: Instant, done: &AtomicU64) {
    let (mut at, mut kept) = (0_u64, std::collections::VecDeque::new());
    while Instant::now() < end {
        let tokens = session.liveliness();
        if kind == "liveliness_queries" {
            drop(tokens.get(SERVICES).callback(|_| {}).await);
        } else {
            let subscriber = tokens.declare_subscriber(SERVICES).history(true);
            keep(&mut kept, subscriber.callback(|_| {}).await);
        }
        tick(&mut at, done).await;
    }
}

/// Keeps a declaration; the outcome of a refused one is irrelevant for an attacker.
fn keep<T>(kept: &mut std::collections::VecDeque<T>, declared: zenoh::Result<T>) {
    if let Ok(declared) = declared {
        kept.push_back(declared);
    }
    if kept.len() > KEPT_MAX {
        kept.pop_front();
    }
}

async fn tick(at: &mut u64, done: &AtomicU64) {
    *at += 1;
    done.fetch_add(1, Ordering::Relaxed);
    if at.is_multiple_of(AT_ONCE) {
        tokio::task::yield_now().await;
    }
}

async fn put(session: &Session, key: &str, document: &Value) {
    let put = session
        .put(key, document.to_string())
        .encoding(zenoh::bytes::Encoding::APPLICATION_JSON)
        .congestion_control(CongestionControl::Block);
    drop(put.await);
}

/// Makes a note of the greatest length, different for each `at`.
fn note(at: u64) -> Value {
    json!({
        "stamp_ns": 1_760_000_000_000_000_000_u64 + at,
        "kind": "maintenance",
        "note": format!("{at:09} {}", "x".repeat(980)),
    })
}

/// Makes a forged acknowledgement of a document that was never sent; every other one is invalid.
fn forged(at: u64) -> Value {
    if at.is_multiple_of(2) {
        return json!({ "nothing": at });
    }
    json!({
        "generation": at % 900,
        "sha256": "0".repeat(64),
        "status": "applied",
        "applied_at_ns": at,
    })
}
