//! A robot's Zenoh session: a client that waits for its router for as long as it takes.

use std::time::Duration;

use fleetcal_proto::{Form, Keys, RobotId, StreamKind};
use tokio::task::JoinError;
use tokio_util::sync::CancellationToken;
use tracing::{Dispatch, debug, dispatcher, info};
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait};

use crate::connection::Connection;
use crate::session_error::SessionError;

/// Timeout of one attempt to connect.
const CONNECT_TIMEOUT_MS: u64 = 2000;
/// Pause between two attempts.
const CONNECT_PAUSE: Duration = Duration::from_secs(1);

pub(crate) fn at_key(key: &str) -> impl FnOnce(zenoh::Error) -> SessionError {
    move |error| SessionError::Key {
        key: key.to_owned(),
        reason: error.to_string(),
    }
}

/// A checked configuration of a client.
#[derive(Debug, Clone)]
pub(crate) struct ClientConfig(zenoh::Config);

impl ClientConfig {
    pub fn new(connect: &Connection) -> Result<Self, SessionError> {
        connect.config(CONNECT_TIMEOUT_MS).map(Self)
    }

    /// Opens a session, repeating until it connects; `None` if stopped before.
    pub async fn open(
        &self,
        robot: &RobotId,
        stop: &CancellationToken,
    ) -> Result<Option<zenoh::Session>, SessionError> {
        let mut attempts = 0_u32;
        while !stop.is_cancelled() {
            let config = self.0.clone();
            match open(config).await? {
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

/// Opens a session on a thread of its own: this blocks until it is connected, or the time is over.
/// Zenoh's lines about it are left out, since the returned error says the same.
pub(crate) async fn open(config: zenoh::Config) -> Result<zenoh::Result<Session>, JoinError> {
    let opens = move || dispatcher::with_default(&Dispatch::none(), || zenoh::open(config).wait());
    tokio::task::spawn_blocking(opens).await
}

/// Declares one of a robot's streams.
pub(crate) async fn publisher(
    session: &zenoh::Session,
    keys: &Keys,
    robot: &RobotId,
    kind: StreamKind,
    form: impl Into<Form>,
) -> Result<Publisher<'static>, SessionError> {
    let key = keys.stream(robot, kind);
    // An acknowledgement must arrive; of the streams the next message is worth more than the last.
    let congestion_control = match kind {
        StreamKind::CalibrationApplied => CongestionControl::Block,
        _ => CongestionControl::Drop,
    };
    session
        .declare_publisher(key.clone())
        .encoding(form.into().to_text())
        .congestion_control(congestion_control)
        .await
        .map_err(at_key(&key))
}

/// Ends a session.
pub(crate) async fn close(session: &zenoh::Session) {
    if let Err(error) = session.close().await {
        debug!(%error, "a robot's Zenoh session did not close");
    }
}
