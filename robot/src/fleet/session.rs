//! The only place of the fleet that knows Zenoh: one client session for each robot.

use std::time::Duration;

use fleetcal_proto::{Encoding, Keys, RobotId, StreamKind};
use thiserror::Error;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;
use tracing::{debug, info, warn};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::CongestionControl;
use zenoh::sample::SampleKind;

/// How long one attempt to connect may take.
const CONNECT_TIMEOUT_MS: u64 = 2000;
/// Pause between two attempts.
const CONNECT_PAUSE: Duration = Duration::from_secs(1);
/// How long a robot waits for the approved calibration.
const PULL_TIMEOUT: Duration = Duration::from_secs(5);
/// Envelopes that wait for the robot; one that finds no room comes again with the next pull.
const APPROVED_QUEUE_MAX: usize = 4;
/// Largest message a robot reads, bytes.
const MESSAGE_BYTES_MAX: usize = 4 * 1024 * 1024;

/// Why Zenoh refused.
#[derive(Debug, Error)]
pub enum SessionError {
    /// The client's configuration cannot be.
    #[error("{field} is {value}: {reason}")]
    Config {
        /// Zenoh's key.
        field: &'static str,
        /// Its value.
        value: String,
        /// What Zenoh says.
        reason: String,
    },
    /// Something could not be declared or sent.
    #[error("{key}: {reason}")]
    Key {
        /// The key expression.
        key: String,
        /// What Zenoh says.
        reason: String,
    },
    /// The thread that opens a session ended.
    #[error("opening a Zenoh session: {0}")]
    Opening(#[from] tokio::task::JoinError),
}

fn at_key(key: &str) -> impl FnOnce(zenoh::Error) -> SessionError {
    move |error| SessionError::Key {
        key: key.to_owned(),
        reason: error.to_string(),
    }
}

/// A checked configuration of a client.
#[derive(Debug, Clone)]
pub(super) struct ClientConfig(zenoh::Config);

impl ClientConfig {
    pub fn new(connect: &[String]) -> Result<Self, SessionError> {
        let endpoints = serde_json::Value::from(connect.to_vec()).to_string();
        let settings = [
            ("mode", "\"client\"".to_owned()),
            ("connect/endpoints", endpoints),
            ("connect/timeout_ms", CONNECT_TIMEOUT_MS.to_string()),
            ("connect/exit_on_failure", "true".to_owned()),
            ("scouting/multicast/enabled", "false".to_owned()),
            ("scouting/gossip/enabled", "false".to_owned()),
            (
                "transport/link/rx/max_message_size",
                MESSAGE_BYTES_MAX.to_string(),
            ),
        ];
        let mut config = zenoh::Config::default();
        for (field, value) in settings {
            config
                .insert_json5(field, &value)
                .map_err(|error| SessionError::Config {
                    field,
                    value,
                    reason: error.to_string(),
                })?;
        }
        Ok(Self(config))
    }

    /// Opens a session, again and again until somebody is there; `None` when told to stop before.
    async fn open(
        &self,
        robot: &RobotId,
        stop: &CancellationToken,
    ) -> Result<Option<zenoh::Session>, SessionError> {
        let mut attempts = 0_u32;
        while !stop.is_cancelled() {
            let config = self.0.clone();
            // Opening blocks its thread until the connection stands or times out.
            let opened = tokio::task::spawn_blocking(move || zenoh::open(config).wait()).await?;
            match opened {
                Ok(session) => return Ok(Some(session)),
                Err(error) if attempts == 0 => {
                    info!(robot.id = %robot, %error, "nobody to connect to yet, trying on");
                }
                Err(error) => debug!(robot.id = %robot, %error, attempts, "still nobody there"),
            }
            attempts = attempts.saturating_add(1);
            tokio::select! {
                () = stop.cancelled() => {}
                () = tokio::time::sleep(CONNECT_PAUSE) => {}
            }
        }
        Ok(None)
    }
}

/// What reaches a robot.
#[derive(Debug)]
pub(super) enum Incoming {
    /// An envelope with a calibration.
    Approved(Vec<u8>),
    /// A service came up.
    ServiceUp,
}

/// A robot's session with its publishers.
#[derive(Debug)]
pub(super) struct RobotSession {
    session: zenoh::Session,
    drive: Publisher<'static>,
    scan: Publisher<'static>,
    lidar_odometry: Publisher<'static>,
    cross_track_error: Publisher<'static>,
    applied: Publisher<'static>,
    approved_key: String,
    incoming_sender: mpsc::Sender<Incoming>,
    /// Held for what they do while they live.
    _subscribers: [Subscriber<()>; 2],
    _token: LivelinessToken,
}

impl RobotSession {
    /// Opens the session and declares everything; `None` when told to stop before.
    pub async fn open(
        config: &ClientConfig,
        keys: &Keys,
        robot: &RobotId,
        stop: &CancellationToken,
    ) -> Result<Option<(Self, mpsc::Receiver<Incoming>)>, SessionError> {
        let Some(session) = config.open(robot, stop).await? else {
            return Ok(None);
        };
        let (incoming_sender, incoming) = mpsc::channel(APPROVED_QUEUE_MAX);
        let publisher = |kind, encoding| publisher(&session, keys, robot, kind, encoding);
        let approved_key = keys.stream(robot, StreamKind::CalibrationApproved);
        // Subscribed before the first pull, so that nothing falls between the two.
        let subscribers = [
            subscribe_approved(&session, &approved_key, incoming_sender.clone()).await?,
            subscribe_services(&session, &keys.service_of_all(), incoming_sender.clone()).await?,
        ];
        let alive = keys.alive(robot);
        let token = session.liveliness().declare_token(alive.clone()).await;
        let robot_session = Self {
            drive: publisher(StreamKind::Drive, Encoding::Cdr).await?,
            scan: publisher(StreamKind::Scan, Encoding::Cdr).await?,
            lidar_odometry: publisher(StreamKind::LidarOdometry, Encoding::Cdr).await?,
            cross_track_error: publisher(StreamKind::CrossTrackError, Encoding::Json).await?,
            applied: publisher(StreamKind::CalibrationApplied, Encoding::Json).await?,
            approved_key,
            incoming_sender,
            _subscribers: subscribers,
            _token: token.map_err(at_key(&alive))?,
            session,
        };
        Ok(Some((robot_session, incoming)))
    }

    /// Sends a message on one of the robot's streams.
    pub async fn send(&self, kind: StreamKind, payload: Vec<u8>) -> Result<(), SessionError> {
        let publisher = match kind {
            StreamKind::Scan => &self.scan,
            StreamKind::LidarOdometry => &self.lidar_odometry,
            StreamKind::CrossTrackError => &self.cross_track_error,
            StreamKind::CalibrationApplied => &self.applied,
            _ => &self.drive,
        };
        let sent = publisher.put(payload).await;
        sent.map_err(at_key(publisher.key_expr().as_str()))
    }

    /// Asks for the approved calibration; the answer comes as [`Incoming::Approved`].
    pub async fn pull(&self) -> Result<(), SessionError> {
        let sender = self.incoming_sender.clone();
        let asked = self
            .session
            .get(&self.approved_key)
            .timeout(PULL_TIMEOUT)
            .callback(move |reply| {
                if let Ok(sample) = reply.result() {
                    offer(&sender, sample.payload().to_bytes().into_owned());
                }
            })
            .await;
        asked.map_err(at_key(&self.approved_key))
    }

    /// Ends the session; the robot's token goes with it.
    pub async fn close(self) {
        if let Err(error) = self.session.close().await {
            debug!(%error, "a robot's Zenoh session did not close");
        }
    }
}

async fn publisher(
    session: &zenoh::Session,
    keys: &Keys,
    robot: &RobotId,
    kind: StreamKind,
    encoding: Encoding,
) -> Result<Publisher<'static>, SessionError> {
    let key = keys.stream(robot, kind);
    // An acknowledgement must arrive; of the streams the next message is worth more than the last.
    let congestion_control = match kind {
        StreamKind::CalibrationApplied => CongestionControl::Block,
        _ => CongestionControl::Drop,
    };
    session
        .declare_publisher(key.clone())
        .encoding(encoding.as_str())
        .congestion_control(congestion_control)
        .await
        .map_err(at_key(&key))
}

async fn subscribe_approved(
    session: &zenoh::Session,
    key: &str,
    sender: mpsc::Sender<Incoming>,
) -> Result<Subscriber<()>, SessionError> {
    session
        .declare_subscriber(key.to_owned())
        .callback(move |sample| {
            if sample.kind() == SampleKind::Put {
                offer(&sender, sample.payload().to_bytes().into_owned());
            }
        })
        .await
        .map_err(at_key(key))
}

async fn subscribe_services(
    session: &zenoh::Session,
    key: &str,
    sender: mpsc::Sender<Incoming>,
) -> Result<Subscriber<()>, SessionError> {
    session
        .liveliness()
        .declare_subscriber(key.to_owned())
        .history(true)
        .callback(move |sample| {
            let up = sample.kind() == SampleKind::Put;
            if up && sender.try_send(Incoming::ServiceUp).is_err() {
                debug!("a service came up while the robot was busy: it pulls within a minute");
            }
        })
        .await
        .map_err(at_key(key))
}

/// Zenoh's threads must never wait, so an envelope that finds no room is left to the next pull.
fn offer(sender: &mpsc::Sender<Incoming>, payload: Vec<u8>) {
    if sender.try_send(Incoming::Approved(payload)).is_err() {
        warn!("an approved calibration found no room: the next pull brings it again");
    }
}
