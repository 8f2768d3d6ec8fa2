//! The only place of a replay that knows Zenoh.

use std::time::Duration;

use fleetcal_proto::progress::Progress;
use fleetcal_proto::{RobotId, StreamKind};
use tokio::time::Instant;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;

use super::{ReplayError, ReplayOptions};
use crate::session;

/// Timeout of one query for the progress.
const PROGRESS_TIMEOUT: Duration = Duration::from_secs(2);
/// Pause between two checks for a listener.
const LISTENER_POLL: Duration = Duration::from_millis(10);

/// Path of the messages of one topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Lane {
    /// The topic in the recording.
    pub(super) topic: String,
    /// The key in Zenoh.
    pub(super) key: String,
    /// The encoding in Zenoh.
    pub(super) encoding: String,
    /// True for a stream of the wheel odometry.
    pub(super) is_wheel_odometry: bool,
}

/// A robot's session: its streams, its token, and the query for the service's progress.
#[derive(Debug)]
pub(super) struct Link {
    session: zenoh::Session,
    robot: RobotId,
    streams: Vec<(Lane, Publisher<'static>)>,
    progress_key: String,
    token: LivelinessToken,
}

fn at_key(key: &str) -> impl FnOnce(zenoh::Error) -> ReplayError {
    move |error| ReplayError::Zenoh {
        key: key.to_owned(),
        reason: error.to_string(),
    }
}

impl Link {
    /// Connects as the robot and declares its streams and its liveliness token.
    pub(super) async fn open(
        options: &ReplayOptions,
        robot: &RobotId,
        lanes: Vec<Lane>,
    ) -> Result<Self, ReplayError> {
        let timeout_ms = options.connect_timeout.as_millis() as u64;
        let config = options.connect.config(timeout_ms)?;
        let session = session::open(config)
            .await?
            .map_err(|error| ReplayError::Connect {
                connection: options.connect.to_string(),
                reason: error.to_string(),
            })?;
        let mut streams = Vec::new();
        for lane in lanes {
            // All streams have the same priority and wait for room: one order, nothing dropped.
            let declared = session
                .declare_publisher(lane.key.clone())
                .encoding(lane.encoding.as_str())
                .congestion_control(CongestionControl::Block);
            let publisher = declared.await.map_err(at_key(&lane.key))?;
            streams.push((lane, publisher));
        }
        let alive = options.keys.alive(robot);
        let token = session.liveliness().declare_token(alive.clone());
        Ok(Self {
            streams,
            progress_key: options.keys.stream(robot, StreamKind::Progress),
            token: token.await.map_err(at_key(&alive))?,
            robot: robot.clone(),
            session,
        })
    }

    /// Returns the id of the robot.
    pub(super) fn robot(&self) -> &RobotId {
        &self.robot
    }

    /// Returns the lane of a topic, and whether it is one of the wheel odometry.
    pub(super) fn lane(&self, topic: &str) -> Option<(usize, bool)> {
        let lanes = self.streams.iter().map(|(lane, _)| lane);
        let found = lanes.enumerate().find(|(_, lane)| lane.topic == topic);
        found.map(|(place, lane)| (place, lane.is_wheel_odometry))
    }

    /// Waits until all streams have a subscriber: earlier messages are lost.
    pub(super) async fn wait_for_listeners(&self, timeout: Duration) -> Result<(), ReplayError> {
        let started = Instant::now();
        for (_, publisher) in &self.streams {
            let key = publisher.key_expr().as_str();
            while !publisher
                .matching_status()
                .await
                .map_err(at_key(key))?
                .matching()
            {
                if started.elapsed() >= timeout {
                    let seconds = timeout.as_secs_f64();
                    return Err(ReplayError::NobodyListens {
                        key: key.to_owned(),
                        seconds,
                    });
                }
                tokio::time::sleep(LISTENER_POLL).await;
            }
        }
        Ok(())
    }

    /// Sends a message on a lane.
    pub(super) async fn send(&self, lane: usize, payload: Vec<u8>) -> Result<(), ReplayError> {
        let Some((_, publisher)) = self.streams.get(lane) else {
            return Ok(());
        };
        publisher
            .put(payload)
            .await
            .map_err(at_key(publisher.key_expr().as_str()))
    }

    /// Queries the service's progress with the robot; `None` without an answer.
    pub(super) async fn progress(&self) -> Result<Option<Progress>, ReplayError> {
        let key = &self.progress_key;
        let asked = self.session.get(key).timeout(PROGRESS_TIMEOUT);
        let replies = asked.await.map_err(at_key(key))?;
        while let Ok(reply) = replies.recv_async().await {
            let Ok(sample) = reply.result() else { continue };
            let progress = serde_json::from_slice(&sample.payload().to_bytes());
            let refused = |reason| ReplayError::ProgressRefused {
                key: key.clone(),
                reason,
            };
            return progress.map(Some).map_err(refused);
        }
        Ok(None)
    }

    /// Undeclares the robot's token and ends the session.
    pub(super) async fn close(self) -> Result<(), ReplayError> {
        self.token
            .undeclare()
            .await
            .map_err(at_key(self.robot.as_str()))?;
        self.session
            .close()
            .await
            .map_err(at_key(self.robot.as_str()))
    }
}
