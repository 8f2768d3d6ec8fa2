//! A service's half of the calibration keys: seals real documents, answers questions, and says what
//! it has stored.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use fleetcal_model::Generation;
use fleetcal_patience::until;
use fleetcal_ports::free_address;
use fleetcal_proto::calibration::{Applied, AppliedStatus, Confirmed, Envelope};
use fleetcal_proto::key::ServiceInstance;
use fleetcal_proto::{Keys, StreamKind};
use tokio::io::copy_bidirectional;
use tokio::net::TcpStream;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::query::{Query, Queryable};

use super::*;

#[derive(Debug, Default)]
struct Stored {
    approved: Option<Envelope>,
    confirmed: Option<Confirmed>,
    answers: Vec<Applied>,
}

/// Returns the question of a robot's query.
pub fn question_of(query: &Query) -> Option<Question> {
    let payload = query.payload()?.try_to_string().ok()?;
    Question::parse(&payload).ok()
}

/// A router, and a service in it once started.
pub struct Service {
    pub endpoint: String,
    session: zenoh::Session,
    stored: Arc<Mutex<Stored>>,
    confirms: Arc<AtomicBool>,
    token: Option<LivelinessToken>,
    queryables: Vec<Queryable<()>>,
}

pub fn free_endpoint() -> String {
    format!("tcp/{}", free_address())
}

impl Service {
    /// Makes a router that does not answer yet, and receives the robots' acknowledgements.
    pub async fn router(endpoint: String) -> Self {
        let mut config = zenoh::Config::default();
        for (key, value) in [
            ("mode", "\"router\"".to_owned()),
            ("listen/endpoints", format!("[\"{endpoint}\"]")),
            ("scouting/multicast/enabled", "false".to_owned()),
            ("scouting/gossip/enabled", "false".to_owned()),
        ] {
            config.insert_json5(key, &value).unwrap();
        }
        let service = Self {
            endpoint,
            session: zenoh::open(config).await.unwrap(),
            stored: Arc::default(),
            confirms: Arc::new(AtomicBool::new(false)),
            token: None,
            queryables: Vec::new(),
        };
        service.listen().await;
        service
    }

    /// Starts a service that confirms what it stores.
    pub async fn start() -> Self {
        let mut service = Self::router(free_endpoint()).await;
        service.confirms(true);
        service.serve().await;
        service
    }

    pub fn confirms(&self, whether: bool) {
        self.confirms.store(whether, Ordering::SeqCst);
    }

    /// Answers queries from now on, then shows its token.
    pub async fn serve(&mut self) {
        let approved = |stored: &Stored, question| {
            let offered = wanted(stored.approved.as_ref()?, question);
            serde_json::to_vec(&offered).ok()
        };
        let confirmed = |stored: &Stored, _| serde_json::to_vec(stored.confirmed.as_ref()?).ok();
        self.answer(StreamKind::CalibrationApproved, approved).await;
        self.answer(StreamKind::CalibrationConfirmed, confirmed)
            .await;
        let instance = ServiceInstance::parse("a1").unwrap();
        let token = Keys::default().service(&instance);
        let declared = self.session.liveliness().declare_token(token).await;
        self.token = Some(declared.unwrap());
    }

    /// Undeclares its token and its queryables.
    pub async fn leave(&mut self) {
        self.token.take().unwrap().undeclare().await.unwrap();
        for queryable in self.queryables.drain(..) {
            queryable.undeclare().await.unwrap();
        }
    }

    /// Stores the approved calibration; the next query returns it.
    pub fn store(&self, envelope: &Envelope) {
        self.stored.lock().unwrap().approved = Some(envelope.clone());
    }

    /// Stores it and pushes it.
    pub async fn approve(&self, envelope: &Envelope) {
        self.store(envelope);
        self.push(serde_json::to_vec(&wanted(envelope, None)).unwrap())
            .await;
    }

    pub async fn push(&self, payload: Vec<u8>) {
        let key = Keys::default().stream(&robot(), StreamKind::CalibrationApproved);
        self.session.put(key, payload).await.unwrap();
    }

    pub fn answers(&self) -> Vec<Applied> {
        self.stored.lock().unwrap().answers.clone()
    }

    /// Returns the first acknowledgement of this kind for a generation.
    pub fn answer_on(&self, generation: u64, status: AppliedStatus) -> Option<Applied> {
        let mut answers = self.answers().into_iter();
        answers
            .find(|answer| answer.generation == Generation(generation) && answer.status == status)
    }

    pub async fn wait_for(&self, generation: u64, status: AppliedStatus) -> Applied {
        let what = format!("{status:?} {generation}");
        until(&what, || self.answer_on(generation, status).is_some()).await;
        self.answer_on(generation, status).unwrap()
    }

    /// Waits until the robot subscribes to pushed documents.
    pub async fn wait_for_robot(&self) {
        let key = Keys::default().stream(&robot(), StreamKind::CalibrationApproved);
        let publisher = self.session.declare_publisher(key).await.unwrap();
        until("the robot listens", || {
            publisher.matching_status().wait().unwrap().matching()
        })
        .await;
    }

    async fn answer(
        &mut self,
        kind: StreamKind,
        payload: fn(&Stored, Option<Question>) -> Option<Vec<u8>>,
    ) {
        let stored = Arc::clone(&self.stored);
        let queryable = self
            .session
            .declare_queryable(Keys::default().stream_of_all(kind));
        let queryable = queryable.complete(true).callback(move |query| {
            if let Some(payload) = payload(&stored.lock().unwrap(), question_of(&query)) {
                let key = Keys::default().stream(&robot(), kind);
                query.reply(key, payload).wait().unwrap();
            }
        });
        self.queryables.push(queryable.await.unwrap());
    }

    /// Stores every acknowledgement, and confirms it afterwards.
    async fn listen(&self) {
        let (sender, mut to_confirm) = mpsc::channel::<Confirmed>(64);
        let (stored, confirms) = (Arc::clone(&self.stored), Arc::clone(&self.confirms));
        let key = Keys::default().stream_of_all(StreamKind::CalibrationApplied);
        let subscriber = self
            .session
            .declare_subscriber(key)
            .callback(move |sample| {
                let answer: Applied = serde_json::from_slice(&sample.payload().to_bytes()).unwrap();
                let confirmed = confirmation_of(&answer);
                let mut stored = stored.lock().unwrap();
                stored.answers.push(answer);
                if confirms.load(Ordering::SeqCst) {
                    stored.confirmed = Some(confirmed.clone());
                    sender.try_send(confirmed).unwrap();
                }
            });
        subscriber.background().await.unwrap();
        let session = self.session.clone();
        tokio::spawn(async move {
            let key = Keys::default().stream(&robot(), StreamKind::CalibrationConfirmed);
            while let Some(confirmed) = to_confirm.recv().await {
                let payload = serde_json::to_vec(&confirmed).unwrap();
                if session.put(&key, payload).await.is_err() {
                    return;
                }
            }
        });
    }
}

/// A link that can be cut: all traffic between its endpoint and the router passes through it.
pub struct Link {
    pub endpoint: String,
    address: String,
    router: String,
    task: Option<JoinHandle<()>>,
}

impl Link {
    pub async fn to(router: &str) -> Self {
        let endpoint = free_endpoint();
        let address = |endpoint: &str| endpoint.strip_prefix("tcp/").unwrap().to_owned();
        let mut link = Self {
            address: address(&endpoint),
            router: address(router),
            endpoint,
            task: None,
        };
        link.mend().await;
        link
    }

    /// Blocks all traffic and connections.
    pub async fn cut(&mut self) {
        let task = self.task.take().unwrap();
        task.abort();
        assert!(task.await.unwrap_err().is_cancelled());
    }

    pub async fn mend(&mut self) {
        let listener = tokio::net::TcpListener::bind(&self.address).await.unwrap();
        let router = self.router.clone();
        self.task = Some(tokio::spawn(async move {
            // Aborted with the task, and every connection with them.
            let mut connections = tokio::task::JoinSet::new();
            loop {
                let (mut near, _) = listener.accept().await.unwrap();
                let router = router.clone();
                connections.spawn(async move {
                    let mut far = TcpStream::connect(router).await.unwrap();
                    // A connection that breaks is what a cut is for.
                    copy_bidirectional(&mut near, &mut far).await.ok();
                });
            }
        }));
    }
}
