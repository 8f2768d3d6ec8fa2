//! Robots and hostile sessions in processes of their own, so that neither's threads are the other's.
//!
//! `fleetcal-crowd robots  ENDPOINT[,ENDPOINT]... SECONDS COUNT RECORDING IDENTITY`
//! `fleetcal-crowd hostile ENDPOINT[,ENDPOINT]... SECONDS SESSIONS KIND IDENTITY`
//!
//! Sessions connect to the endpoints in turn. IDENTITY is `anonymous`, `passwords`, or a folder of
//! certificates; hostile sessions then connect under the name of `robot_50`.
//!
//! It says a line of JSON when all are connected, and one with what was sent at the end.

#![expect(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a process for a test, whose failure is to be seen"
)]

mod flood_kinds;
mod hostile;
mod session;

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::{Value, json};
use tokio::task::JoinSet;
use tokio::time::{Instant, MissedTickBehavior};
use zenoh::Session;
use zenoh::qos::CongestionControl;

/// A robot's messages: the due time of each after the start, its stream, and its payload.
type Script = Vec<(Duration, &'static str, Vec<u8>)>;

/// Robots that connect at once.
const CONNECT_AT_ONCE: usize = 8;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [what, endpoints, seconds, count, kind, identity] = words.as_slice() else {
        panic!("expected robots|hostile ENDPOINTS SECONDS COUNT RECORDING|KIND IDENTITY");
    };
    let place = Place {
        endpoints: endpoints.split(',').map(str::to_owned).collect(),
        identity: match identity.as_str() {
            "anonymous" => Identity::Anonymous,
            "passwords" => Identity::Password,
            folder => Identity::Certificate(folder.into()),
        },
    };
    let duration = Duration::from_secs(seconds.parse().unwrap());
    let count = count.parse().unwrap();
    let mut runtime = tokio::runtime::Builder::new_multi_thread();
    let runtime = runtime.worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(async {
        match what.as_str() {
            "robots" => robots(&place, duration, count, Path::new(kind)).await,
            "hostile" => hostile::sessions(&place, duration, count, kind).await,
            other => panic!("{other} is neither robots nor hostile"),
        }
    });
}

/// Prints one line at once.
fn say(said: &Value) {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{said}").unwrap();
    out.flush().unwrap();
}

/// Authentication of sessions.
#[derive(Debug, Clone)]
enum Identity {
    /// No authentication.
    Anonymous,
    /// The name backwards as password.
    Password,
    /// The certificate of that name in a folder.
    Certificate(PathBuf),
}

/// Endpoints and authentication of sessions.
#[derive(Debug, Clone)]
struct Place {
    endpoints: Vec<String>,
    identity: Identity,
}

impl Place {
    /// Opens the session of a number, under a name if names are in use.
    async fn connect(&self, number: usize, name: &str) -> Session {
        let endpoint = &self.endpoints[number % self.endpoints.len()];
        let config = match &self.identity {
            Identity::Anonymous => session::client(endpoint, &json!({})),
            Identity::Password => {
                let password: String = name.chars().rev().collect();
                session::with_password(endpoint, name, &password)
            }
            Identity::Certificate(folder) => {
                session::client(endpoint, &session::tls(folder, Some(name)))
            }
        };
        session::open(config).await.unwrap()
    }
}

/// Drives `count` robots `robot_01` and so on through the same recording, each with a session of
/// its own; messages without room are dropped, as by a robot's own streams.
async fn robots(place: &Place, duration: Duration, count: usize, recording: &Path) {
    let script = script(recording, duration);
    let mut sessions = Vec::new();
    let ids: Vec<(usize, String)> = (1..=count)
        .map(|number| (number, format!("robot_{number:02}")))
        .collect();
    for ids in ids.chunks(CONNECT_AT_ONCE) {
        let open = ids.iter().cloned().map(|(number, id)| {
            let place = place.clone();
            tokio::spawn(async move {
                let session = place.connect(number, &id).await;
                (id, session)
            })
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

    /// Sends all messages when they are due.
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

/// Reads the messages of a recording's beginning.
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
