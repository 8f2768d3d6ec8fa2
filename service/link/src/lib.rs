//! The one crate of the service that knows Zenoh: the embedded router, what comes in, what goes out.

mod access;
mod anonymous;
mod calibration;
mod ingest;
mod outgoing;
mod questions;
mod ros2;
mod session;
mod strict;

use std::path::PathBuf;
use std::pin::Pin;

use fleetcal_clock::SharedClock;
use fleetcal_domain::limits;
use fleetcal_domain::streams::Ros2Settings;
use fleetcal_fleet::FleetHandle;
use fleetcal_proto::key::{KeyRefused, Keys, ServiceInstance};
use thiserror::Error;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;
use zenoh::Session;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::query::Queryable;

use fleetcal_operations::lifecycle::Lifecycle;
use questions::Questions;
use ros2::{Ros2Link, RouteTable};

pub use strict::{Identity, RouterCertificate, StrictRouter, is_robots_own};

/// What the link is made with.
#[derive(Debug, Clone, Default)]
pub struct LinkSetup {
    /// Endpoints that the embedded router listens on.
    pub listen: Vec<String>,
    /// Routers to connect to.
    pub connect: Vec<String>,
    /// A native Zenoh configuration file, taken as it is instead of the embedded router; `listen` and
    /// `connect` replace the endpoints in it when there are any.
    pub zenoh_config: Option<PathBuf>,
    /// Whether peers beyond this machine may connect without showing who they are.
    pub allow_anonymous: bool,
    /// The keys under the configured root.
    pub keys: Keys,
    /// Where ROS 2 robots' topics are.
    pub ros2: Ros2Settings,
}

/// Why the link could not be opened.
#[derive(Debug, Error)]
pub enum LinkError {
    /// The configuration was refused.
    #[error("the Zenoh configuration is refused: {0}")]
    Config(String),
    /// Anybody beyond this machine could connect.
    #[error(
        "Zenoh would take anybody who reaches {endpoint}, without authentication: give -c a \
         configuration of `fleetcal acl generate`, or --allow-anonymous where everybody on the \
         network is trusted"
    )]
    Anonymous {
        /// Where.
        endpoint: String,
    },
    /// The session could not be opened.
    #[error("Zenoh cannot be opened on {endpoints}: {reason}")]
    Open {
        /// Where it was to listen and connect.
        endpoints: String,
        /// What Zenoh says.
        reason: String,
    },
    /// The session was not open in time.
    #[error("Zenoh on {endpoints} did not open within {} s", limits::ZENOH_OPEN_TIMEOUT.as_secs())]
    Timeout {
        /// Where it was to listen and connect.
        endpoints: String,
    },
    /// A subscriber, queryable or token could not be declared.
    #[error("Zenoh refused to declare {what}: {reason}")]
    Declare {
        /// What was to be declared.
        what: &'static str,
        /// What Zenoh says.
        reason: String,
    },
    /// The session's own name is no chunk of a key.
    #[error(transparent)]
    Instance(#[from] KeyRefused),
}

/// A future that is compiled in this crate, and not in each that awaits it.
pub type Boxed<T> = Pin<Box<dyn Future<Output = T> + Send>>;

/// The open link. Dropping it without [`Link::close`] leaves the session open until the process
/// ends.
#[derive(Debug)]
pub struct Link {
    session: Session,
    streams: Subscriber<()>,
    presence: Subscriber<()>,
    progress: Queryable<()>,
    token: LivelinessToken,
    approved: Queryable<()>,
    confirmed: Queryable<()>,
    answers: Subscriber<()>,
    ros2: Ros2Link,
    publisher: JoinHandle<()>,
    poster: JoinHandle<()>,
    stop: CancellationToken,
}

impl LinkSetup {
    /// Checks what [`Link::open`] would refuse before it opens anything.
    ///
    /// # Errors
    /// When the configuration is refused, or anybody could connect and that is not allowed.
    pub fn check(&self) -> Result<(), LinkError> {
        session::configuration(self, &[]).map(drop)
    }
}

impl Link {
    /// Opens the session, subscribes to every robot, and begins to publish estimates.
    ///
    /// # Errors
    /// When the configuration is refused, an endpoint is in use, or Zenoh does not open in time.
    pub fn open(
        setup: LinkSetup,
        fleet: FleetHandle,
        lifecycle: Lifecycle,
        clock: SharedClock,
    ) -> Boxed<Result<Self, LinkError>> {
        Box::pin(Self::opened(setup, fleet, lifecycle, clock))
    }

    async fn opened(
        setup: LinkSetup,
        fleet: FleetHandle,
        lifecycle: Lifecycle,
        clock: SharedClock,
    ) -> Result<Self, LinkError> {
        let table = RouteTable::new(&setup.ros2, setup.keys.root(), fleet.streams());
        let session = session::open(&setup, &ros2::access::rules(&table)).await?;
        let stop = CancellationToken::new();
        let keys = setup.keys;
        let declared = |what| {
            move |error: zenoh::Error| LinkError::Declare {
                what,
                reason: error.to_string(),
            }
        };
        let presence = ingest::watch_presence(&session, &keys, fleet.clone())
            .await
            .map_err(declared("the subscriber of liveliness tokens"))?;
        let progress = outgoing::answer_progress(&session, &keys, fleet.clone())
            .await
            .map_err(declared("the queryable of progress"))?;
        let questions = Questions::new(fleet.clone());
        let approved = calibration::answer_approved(&session, &keys, lifecycle.clone(), &questions)
            .await
            .map_err(declared("the queryable of approved calibrations"))?;
        let confirmed = calibration::answer_confirmed(&session, &keys, lifecycle.clone())
            .await
            .map_err(declared("the queryable of confirmations"))?;
        let answers = calibration::hear_answers(&session, &keys, lifecycle.clone())
            .await
            .map_err(declared("the subscriber of robots' answers"))?;
        let streams = ingest::subscribe(&session, &keys, fleet.clone())
            .await
            .map_err(declared("the subscriber of robots' streams"))?;
        let surroundings = ros2::Surroundings {
            fleet: fleet.clone(),
            lifecycle: lifecycle.clone(),
            clock,
            questions,
        };
        let ros2 = Ros2Link::open(&session, table, surroundings, stop.clone())
            .await
            .map_err(declared("what ROS 2 robots need"))?;
        // Last: a robot that sees the token finds everything else there.
        let instance = ServiceInstance::parse(&session.zid().to_string())?;
        let token = session
            .liveliness()
            .declare_token(keys.service(&instance))
            .await
            .map_err(declared("the service's liveliness token"))?;
        let (own, own_keys, to_ros2) = (session.clone(), keys.clone(), ros2.shared());
        let posting = calibration::send_outbox(own, own_keys, lifecycle, to_ros2, stop.clone());
        let poster = tokio::spawn(posting);
        let publishing = outgoing::publish_estimates(session.clone(), keys, fleet, stop.clone());
        let publisher = tokio::spawn(publishing);
        Ok(Self {
            session,
            streams,
            presence,
            progress,
            token,
            approved,
            confirmed,
            answers,
            ros2,
            publisher,
            poster,
            stop,
        })
    }

    /// Whether the session is open.
    pub fn is_open(&self) -> bool {
        !self.session.is_closed()
    }

    /// Takes no further message, then closes the session.
    pub fn close(self) -> Boxed<()> {
        Box::pin(self.closed())
    }

    async fn closed(self) {
        self.stop.cancel();
        for undeclared in [
            self.token.undeclare().await,
            self.streams.undeclare().await,
            self.presence.undeclare().await,
            self.progress.undeclare().await,
            self.approved.undeclare().await,
            self.confirmed.undeclare().await,
            self.answers.undeclare().await,
        ] {
            if let Err(error) = undeclared {
                tracing::warn!(error, "Zenoh refused to undeclare");
            }
        }
        self.ros2.close().await;
        if let Err(error) = self.publisher.await {
            tracing::error!(%error, "the publisher of estimates failed");
        }
        if let Err(error) = self.poster.await {
            tracing::error!(%error, "the sender of calibrations failed");
        }
        session::close(self.session).await;
    }
}
