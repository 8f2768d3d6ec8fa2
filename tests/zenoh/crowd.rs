//! Robots and hostile sessions in processes of their own, so that neither's threads are the other's.
//!
//! `fleetcal-crowd robots  ENDPOINT SECONDS COUNT RECORDING anonymous|passwords`
//! `fleetcal-crowd hostile ENDPOINT SECONDS SESSIONS KIND ROBOT|-`
//!
//! It says a line of JSON when all are connected, and one with what was sent at the end.

#![expect(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a process for a test, whose failure is to be seen"
)]

mod hostile;
mod session;

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;
use std::time::Duration;

use serde_json::{Value, json};
use tokio::task::JoinSet;
use tokio::time::{Instant, MissedTickBehavior};
use zenoh::Session;
use zenoh::qos::CongestionControl;

/// A robot's messages: when each is due after the start, on which stream, and its bytes.
type Script = Vec<(Duration, &'static str, Vec<u8>)>;

/// Robots that connect at once.
const CONNECT_AT_ONCE: usize = 8;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [what, endpoint, seconds, count, kind, who] = words.as_slice() else {
        panic!("expected robots|hostile ENDPOINT SECONDS COUNT RECORDING|KIND WHO");
    };
    let duration = Duration::from_secs(seconds.parse().unwrap());
    let count = count.parse().unwrap();
    let mut runtime = tokio::runtime::Builder::new_multi_thread();
    let runtime = runtime.worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(async {
        match what.as_str() {
            "robots" => robots(endpoint, duration, count, Path::new(kind), who).await,
            "hostile" => hostile::sessions(endpoint, duration, count, kind, who).await,
            other => panic!("{other} is neither robots nor hostile"),
        }
    });
}

/// One line at once.
fn say(said: &Value) {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{said}").unwrap();
    out.flush().unwrap();
}

/// A session under a name, which is also its password backwards, or under none.
async fn connect(endpoint: &str, name: Option<&str>) -> Session {
    let config = match name {
        Some(name) => {
            let password: String = name.chars().rev().collect();
            session::with_password(endpoint, name, &password)
        }
        None => session::client(endpoint, &json!({})),
    };
    session::open(config).await.unwrap()
}

/// Drives `count` robots `robot_01` and so on through the same recording, each with a session of its
/// own; what finds no room is dropped, as a robot's own streams do.
async fn robots(endpoint: &str, duration: Duration, count: usize, recording: &Path, who: &str) {
    let script = script(recording, duration);
    let mut sessions = Vec::new();
    let ids: Vec<String> = (1..=count)
        .map(|number| format!("robot_{number:02}"))
        .collect();
    for ids in ids.chunks(CONNECT_AT_ONCE) {
        let open = ids.iter().map(|id| {
            let name = (who == "passwords").then(|| id.clone());
            let (endpoint, id) = (endpoint.to_owned(), id.clone());
            tokio::spawn(async move { (id, connect(&endpoint, name.as_deref()).await) })
        });
        for opened in open.collect::<Vec<_>>() {
            sessions.push(opened.await.unwrap());
        }
    }
    let mut ready = Vec::new();
    for (id, session) in sessions {
        ready.push(Robot::new(id, session).await);
    }
    say(&json!({ "ready": ready.len() }));
    let script = std::sync::Arc::new(script);
    let start = Instant::now();
    let mut driving = JoinSet::new();
    for robot in ready {
        let script = std::sync::Arc::clone(&script);
        driving.spawn(async move { robot.drive(&script, start).await });
    }
    let mut sent = BTreeMap::new();
    while let Some(ended) = driving.join_next().await {
        let (id, of_robot) = ended.unwrap();
        sent.insert(id, of_robot);
    }
    say(&json!({ "sent": sent }));
}

struct Robot {
    id: String,
    session: Session,
    streams: BTreeMap<&'static str, zenoh::pubsub::Publisher<'static>>,
    token: zenoh::liveliness::LivelinessToken,
}

impl Robot {
    async fn new(id: String, session: Session) -> Self {
        let token = session
            .liveliness()
            .declare_token(format!("fleet/@alive/{id}"));
        let token = token.await.unwrap();
        let mut streams = BTreeMap::new();
        for stream in ["wheel_odometry", "scan"] {
            let publisher = session
                .declare_publisher(format!("fleet/{id}/{stream}"))
                .congestion_control(CongestionControl::Drop)
                .await
                .unwrap();
            let matching = async {
                while !publisher.matching_status().await.unwrap().matching() {
                    tokio::time::sleep(Duration::from_millis(20)).await;
                }
            };
            tokio::time::timeout(session::PATIENCE, matching)
                .await
                .unwrap();
            streams.insert(stream, publisher);
        }
        Self {
            id,
            session,
            streams,
            token,
        }
    }

    /// Sends everything when it is due.
    async fn drive(self, script: &Script, start: Instant) -> (String, Value) {
        let mut sent: BTreeMap<&str, u64> = BTreeMap::new();
        let mut ticks = tokio::time::interval_at(start, Duration::from_millis(5));
        ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
        let mut due = script.iter().peekable();
        while due.peek().is_some() {
            let now = ticks.tick().await;
            while let Some((_, stream, payload)) = due.next_if(|(at, _, _)| start + *at <= now) {
                self.streams[stream].put(payload.clone()).await.unwrap();
                *sent.entry(stream).or_default() += 1;
            }
        }
        self.token.undeclare().await.unwrap();
        self.session.close().await.unwrap();
        (self.id, json!(sent))
    }
}

/// The messages of a recording's beginning.
fn script(recording: &Path, duration: Duration) -> Script {
    let bytes = std::fs::read(recording).unwrap();
    let mut script = Script::new();
    let mut first = None;
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let topic = &message.channel.topic;
        let stream = match topic.rsplit('/').next() {
            Some("wheel_odometry") => "wheel_odometry",
            Some("scan") => "scan",
            _ => continue,
        };
        let first = *first.get_or_insert(message.log_time);
        let at = Duration::from_nanos(message.log_time.saturating_sub(first));
        if at < duration {
            script.push((at, stream, message.data.into_owned()));
        }
    }
    script.sort_by_key(|(at, _, _)| *at);
    script
}
