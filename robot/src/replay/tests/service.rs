//! Counterpart of a replay in tests: a router with the service's subscribers, its progress
//! queryable, and a mailbox of its size that is worked through at a given pace.

use std::collections::{BTreeSet, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::Duration;

use fleetcal_model::RobotTime;
use fleetcal_ports::free_address;
use fleetcal_proto::progress::Progress;
use fleetcal_proto::ros::{AckermannDriveStamped, LaserScan, Odometry, RosMessage};
use fleetcal_proto::{Encoding, Key, Keys, StreamKind};
use zenoh::pubsub::Subscriber;
use zenoh::query::Queryable;
use zenoh::sample::{Sample, SampleKind};

/// Sizes of the service's mailbox.
const MAILBOX: [usize; 2] = [1024, 8];

/// Observations of the service.
#[derive(Debug, Clone, Default)]
pub struct Seen {
    /// Stamps of the processed messages, in their order.
    pub stamps_ns: Vec<i64>,
    /// Keys of the messages.
    pub keys: BTreeSet<String>,
    /// Encodings of the messages.
    pub encodings: Vec<String>,
    /// Most drive samples and scans that waited at once.
    pub waiting_max: [usize; 2],
    /// Changes of the liveliness token.
    pub token: Vec<String>,
    /// Number of messages processed before the token disappeared.
    pub done_when_token_went: usize,
}

#[derive(Debug, Default)]
struct Inbox {
    queue: VecDeque<(StreamKind, Vec<u8>)>,
    progress: Progress,
    seen: Seen,
    closed: bool,
}

impl Inbox {
    fn waiting(&self, is_wheel_odometry: bool) -> usize {
        self.queue
            .iter()
            .filter(|(kind, _)| (*kind == StreamKind::WheelOdometry) == is_wheel_odometry)
            .count()
    }

    fn push(&mut self, sample: &Sample) {
        let key = sample.key_expr().as_str();
        let Ok(Key::Stream { kind, .. }) = Keys::default().parse(key) else {
            panic!("{key} is no stream");
        };
        self.seen.keys.insert(key.to_owned());
        let encoding = sample.encoding().to_string();
        if !self.seen.encodings.contains(&encoding) {
            self.seen.encodings.push(encoding);
        }
        let is_wheel_odometry = kind == StreamKind::WheelOdometry;
        let class = usize::from(!is_wheel_odometry);
        if self.waiting(is_wheel_odometry) == MAILBOX[class] {
            let oldest = self
                .queue
                .iter()
                .position(|(k, _)| (*k == StreamKind::WheelOdometry) == is_wheel_odometry);
            self.queue.remove(oldest.unwrap());
            self.progress.dropped += 1;
        }
        self.queue
            .push_back((kind, sample.payload().to_bytes().into_owned()));
        let waiting = self.waiting(is_wheel_odometry);
        self.seen.waiting_max[class] = self.seen.waiting_max[class].max(waiting);
    }

    fn finish(&mut self, kind: StreamKind, payload: &[u8]) {
        let header = match kind {
            StreamKind::WheelOdometry => AckermannDriveStamped::from_cdr(payload).unwrap().header,
            StreamKind::Scan => LaserScan::from_cdr(payload).unwrap().header,
            _ => Odometry::from_cdr(payload).unwrap().header,
        };
        self.seen.stamps_ns.push(header.stamp.as_ns());
        match kind {
            StreamKind::WheelOdometry => self.progress.drive_samples += 1,
            _ => self.progress.scans += 1,
        }
    }
}

type Shared = Arc<(Mutex<Inbox>, Condvar)>;

fn lock(shared: &Shared) -> MutexGuard<'_, Inbox> {
    shared.0.lock().unwrap()
}

/// A router and a service in it.
pub struct Service {
    /// Endpoint that it listens on.
    pub endpoint: String,
    /// Set to make the service forget its counts, as a restart does; unset once it did.
    pub forget: Arc<AtomicBool>,
    session: zenoh::Session,
    shared: Shared,
    progress: Mutex<Option<Queryable<()>>>,
    _subscribers: Vec<Subscriber<()>>,
}

impl Drop for Service {
    fn drop(&mut self) {
        lock(&self.shared).closed = true;
        self.shared.1.notify_all();
    }
}

impl Service {
    /// Starts a router with a service that takes `pace` for each message.
    pub async fn start(pace: Duration) -> Self {
        Self::start_at(format!("tcp/{}", free_address()), pace).await
    }

    /// Starts it at another one's endpoint.
    pub async fn start_at(endpoint: String, pace: Duration) -> Self {
        let session = router_at(&endpoint).await;
        // It had other senders before.
        let progress = Progress {
            drive_samples: 5000,
            scans: 400,
            dropped: 3,
            stamp_ns: RobotTime(1),
        };
        let inbox = Inbox {
            progress,
            ..Inbox::default()
        };
        let shared: Shared = Arc::new((Mutex::new(inbox), Condvar::new()));
        let forget = Arc::new(AtomicBool::new(false));
        let keys = Keys::default();
        let mut subscribers = Vec::new();
        for kind in [
            StreamKind::WheelOdometry,
            StreamKind::Scan,
            StreamKind::LidarOdometry,
        ] {
            let inbox = Arc::clone(&shared);
            let subscriber = session.declare_subscriber(keys.stream_of_all(kind));
            let subscriber = subscriber.callback(move |sample| {
                lock(&inbox).push(&sample);
                inbox.1.notify_all();
            });
            subscribers.push(subscriber.await.unwrap());
        }
        subscribers.push(watch_tokens(&session, Arc::clone(&shared)).await);
        let progress = answer_progress(&session, Arc::clone(&shared)).await;
        let (inbox, forgets) = (Arc::clone(&shared), Arc::clone(&forget));
        std::thread::spawn(move || work(&inbox, &forgets, pace));
        Self {
            endpoint,
            forget,
            session,
            shared,
            progress: Mutex::new(Some(progress)),
            _subscribers: subscribers,
        }
    }

    /// Returns its observations so far.
    pub fn seen(&self) -> Seen {
        lock(&self.shared).seen.clone()
    }

    /// Closes without notice.
    pub async fn stop(&self) {
        self.session.close().await.unwrap();
    }

    /// Stops answering queries for its progress.
    pub async fn silence(&self) {
        let queryable = self.progress.lock().unwrap().take();
        queryable.unwrap().undeclare().await.unwrap();
    }

    /// Waits until the robot's token disappears.
    pub async fn wait_until_gone(&self) {
        while self.seen().token.len() < 2 {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        assert!(!self.session.is_closed());
    }
}

async fn watch_tokens(session: &zenoh::Session, inbox: Shared) -> Subscriber<()> {
    let tokens = session
        .liveliness()
        .declare_subscriber(Keys::default().alive_of_all());
    let watching = tokens.history(true).callback(move |sample| {
        let mut inbox = lock(&inbox);
        let what = match sample.kind() {
            SampleKind::Put => "put",
            SampleKind::Delete => "delete",
        };
        inbox
            .seen
            .token
            .push(format!("{what} {}", sample.key_expr()));
        if sample.kind() == SampleKind::Delete {
            inbox.seen.done_when_token_went = inbox.seen.stamps_ns.len();
        }
    });
    watching.await.unwrap()
}

async fn answer_progress(session: &zenoh::Session, inbox: Shared) -> Queryable<()> {
    let queryable = session.declare_queryable(Keys::default().stream_of_all(StreamKind::Progress));
    let answering = queryable.complete(true).callback(move |query| {
        let progress = lock(&inbox).progress;
        let payload = serde_json::to_vec(&progress).unwrap();
        let reply = query.reply(query.key_expr().clone(), payload);
        zenoh::Wait::wait(reply.encoding(Encoding::Json.as_str())).unwrap();
    });
    answering.await.unwrap()
}

/// Processes the mailbox until the service is dropped.
fn work(inbox: &Shared, forget: &AtomicBool, pace: Duration) {
    loop {
        let next = {
            let waiting = lock(inbox);
            let mut ready = inbox
                .1
                .wait_while(waiting, |inbox| inbox.queue.is_empty() && !inbox.closed)
                .unwrap();
            if ready.closed {
                return;
            }
            if forget.swap(false, Ordering::SeqCst) {
                ready.progress = Progress::default();
            }
            ready.queue.pop_front()
        };
        if let Some((kind, payload)) = next {
            std::thread::sleep(pace);
            lock(inbox).finish(kind, &payload);
        }
    }
}

/// Opens a router without a service; returns it with its endpoint.
pub async fn router() -> (zenoh::Session, String) {
    let endpoint = format!("tcp/{}", free_address());
    (router_at(&endpoint).await, endpoint)
}

async fn router_at(endpoint: &str) -> zenoh::Session {
    let mut config = zenoh::Config::default();
    let settings = [
        ("mode", "\"router\"".to_owned()),
        ("listen/endpoints", format!("[\"{endpoint}\"]")),
        ("scouting/multicast/enabled", "false".to_owned()),
        ("scouting/gossip/enabled", "false".to_owned()),
    ];
    for (field, value) in settings {
        config.insert_json5(field, &value).unwrap();
    }
    zenoh::open(config).await.unwrap()
}
