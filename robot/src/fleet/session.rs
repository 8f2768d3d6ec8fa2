//! The only place of the fleet that knows Zenoh: one client session for each robot.

use fleetcal_proto::signing::TrustedKeys;
use fleetcal_proto::{Encoding, Form, Keys, MessageType, RobotId, StreamKind};
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;

use super::DriveMessages;
use crate::agent::{CalibrationLink, Event};
use crate::session::{ClientConfig, at_key, close, publisher};
use crate::session_error::SessionError;

/// A robot's session with its publishers.
#[derive(Debug)]
pub(super) struct RobotSession {
    session: zenoh::Session,
    wheel_odometry: Publisher<'static>,
    scan: Publisher<'static>,
    lidar_odometry: Publisher<'static>,
    cross_track_error: Publisher<'static>,
    robot_description: Publisher<'static>,
    /// Its calibration keys.
    pub calibration: CalibrationLink,
    /// Token, present while it lives.
    _token: LivelinessToken,
}

impl RobotSession {
    /// Opens the session and declares everything; `None` if stopped before.
    pub async fn open(
        config: &ClientConfig,
        keys: &Keys,
        robot: &RobotId,
        trusted: Option<watch::Receiver<TrustedKeys>>,
        drive_messages: DriveMessages,
        stop: &CancellationToken,
    ) -> Result<Option<(Self, mpsc::Receiver<Event>)>, SessionError> {
        let Some(session) = config.open(robot, stop).await? else {
            return Ok(None);
        };
        let (calibration, incoming) =
            CalibrationLink::declare(&session, keys, robot, trusted).await?;
        let publisher = |kind, form: Form| publisher(&session, keys, robot, kind, form);
        let wheel_odometry = Form {
            encoding: Encoding::Cdr,
            message_type: match drive_messages {
                DriveMessages::Several => Some(MessageType::DriveSamples),
                DriveMessages::Single => None,
            },
        };
        let (cdr, json) = (Form::from(Encoding::Cdr), Form::from(Encoding::Json));
        let alive = keys.alive(robot);
        let token = session.liveliness().declare_token(alive.clone()).await;
        let robot_session = Self {
            wheel_odometry: publisher(StreamKind::WheelOdometry, wheel_odometry).await?,
            scan: publisher(StreamKind::Scan, cdr).await?,
            lidar_odometry: publisher(StreamKind::LidarOdometry, cdr).await?,
            cross_track_error: publisher(StreamKind::CrossTrackError, json).await?,
            robot_description: publisher(StreamKind::RobotDescription, cdr).await?,
            calibration,
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
            StreamKind::RobotDescription => &self.robot_description,
            _ => &self.wheel_odometry,
        };
        let sent = publisher.put(payload).await;
        sent.map_err(at_key(publisher.key_expr().as_str()))
    }

    /// Ends the session, and with it the robot's token.
    pub async fn close(self) {
        close(&self.session).await;
    }
}
