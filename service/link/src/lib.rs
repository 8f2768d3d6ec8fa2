//! The one crate of the service that knows Zenoh: the embedded router, what comes in, what goes out.

mod access;
mod anonymous;
mod answers;
mod bounds;
mod calibration;
mod cluster;
mod description;
mod gate;
mod heard;
mod ingest;
mod outgoing;
pub mod password_file;
mod places;
mod questions;
mod ros2;
mod session;
mod session_memory;
mod sessions;
mod setting;
mod strict;

use std::path::PathBuf;
use std::pin::Pin;

use fleetcal_clock::SharedClock;
use fleetcal_cluster::{LinkReport, Membership};
use fleetcal_domain::limits;
use fleetcal_domain::streams::Ros2Settings;
use fleetcal_fleet::FleetHandle;
use fleetcal_proto::key::{KeyRefused, Keys, ServiceInstance, StreamKind};
use thiserror::Error;
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;
use zenoh::Session;
use zenoh::internal::runtime::Runtime;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::query::Queryable;

use cluster::{ClusterLink, ClusterParts};
use fleetcal_operations::lifecycle::Lifecycle;
use gate::Gate;
use heard::HeardStreams;
use password_file::PasswordFileRefused;
use questions::Questions;
use ros2::{Ros2, Ros2Link, RouteTable};
use session::Opened;
use sessions::Sessions;

pub use places::Shares;
pub use session_memory::SessionMemory;
pub use strict::{Identity, RouterCertificate, StrictRouter, is_robots_own};

/// Settings and parts that the link is made with.
#[derive(Debug, Clone, Default)]
pub struct LinkSetup {
    /// Endpoints that the embedded router listens on.
    pub listen: Vec<String>,
    /// Routers to connect to.
    pub connect: Vec<String>,
    /// A native Zenoh configuration file, used unchanged (except for QUIC endpoints, see
    /// [`fleetcal_proto::endpoint`]) instead of the embedded router; `listen` and `connect` replace
    /// its endpoints if they are not empty.
    pub zenoh_config: Option<PathBuf>,
    /// True if peers beyond this machine may connect without authentication.
    pub allow_anonymous: bool,
    /// The keys under the configured root.
    pub keys: Keys,
    /// Settings of the topics of ROS 2 robots.
    pub ros2: Ros2Settings,
    /// Largest numbers of sessions; a router that opens fewer has fewer in total.
    pub shares: Shares,
    /// Memory of the process, the newest sessions of which are closed where it is short.
    pub session_memory: Option<SessionMemory>,
    /// This process's place in a cluster.
    pub membership: Membership,
    /// Channel of the state of a cluster instance's link.
    pub report: watch::Sender<LinkReport>,
}

/// Reason for which the link could not be opened.
#[derive(Debug, Error)]
pub enum LinkError {
    /// The configuration was refused.
    #[error("the Zenoh configuration is refused: {0}")]
    Config(String),
    /// The password file is missing or unusable.
    #[error(
        "the passwords of the Zenoh configuration: {0}; `fleetcal acl generate --identity user \
         --passwords FILE` makes a file with a line `user:password` for each robot"
    )]
    Passwords(#[from] PasswordFileRefused),
    /// Anybody beyond this machine could connect.
    #[error(
        "Zenoh would take anybody who reaches {endpoint}, without authentication: give -c a \
         configuration of `fleetcal acl generate`, or --allow-anonymous where everybody on the \
         network is trusted"
    )]
    Anonymous {
        /// The open endpoint.
        endpoint: String,
    },
    /// The session could not be opened.
    #[error("Zenoh cannot be opened on {endpoints}: {reason}")]
    Open {
        /// Endpoints to listen on and connect to.
        endpoints: String,
        /// Zenoh's reason.
        reason: String,
    },
    /// The session was not open in time.
    #[error("Zenoh on {endpoints} did not open within {} s", limits::ZENOH_OPEN_TIMEOUT.as_secs())]
    Timeout {
        /// Endpoints to listen on and connect to.
        endpoints: String,
    },
    /// A subscriber, queryable or token could not be declared.
    #[error("Zenoh refused to declare {what}: {reason}")]
    Declare {
        /// The declaration.
        what: &'static str,
        /// Zenoh's reason.
        reason: String,
    },
    /// The session's own name is not a valid chunk of a key.
    #[error(transparent)]
    Instance(#[from] KeyRefused),
}

/// Future that is compiled in this crate instead of each that awaits it.
pub type Boxed<T> = Pin<Box<dyn Future<Output = T> + Send>>;

/// The open link. Dropping it without [`Link::close`] leaves the session open until the process
/// ends.
#[derive(Debug)]
pub struct Link {
    session: Session,
    runtime: Runtime,
    presence: Subscriber<()>,
    descriptions: [Subscriber<()>; 2],
    progress: Queryable<()>,
    /// Declarations of a service that has all robots.
    all: Option<AllRobots>,
    /// Part of an instance of a cluster.
    cluster: Option<ClusterLink>,
    ros2: Ros2Link,
    publisher: JoinHandle<()>,
    poster: JoinHandle<()>,
    stop: CancellationToken,
}

/// Declarations of a service that has all robots.
#[derive(Debug)]
struct AllRobots {
    token: LivelinessToken,
    declared: DeclaredForAll,
}

/// Same declarations without the token.
#[derive(Debug)]
struct DeclaredForAll {
    streams: Subscriber<()>,
    approved: Queryable<()>,
    confirmed: Queryable<()>,
    answers: Subscriber<()>,
}

impl LinkSetup {
    /// Checks, before anything is opened, for the refusals of [`Link::open`].
    ///
    /// # Errors
    /// The configuration is refused, or anybody could connect and that is not allowed.
    pub fn check(&self) -> Result<(), LinkError> {
        session::configuration(self, &[]).map(drop)
    }
}

impl Link {
    /// Opens the session, subscribes to every robot, and begins to publish estimates.
    ///
    /// # Errors
    /// The configuration is refused, an endpoint is in use, or Zenoh does not open in time.
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
        let mut table = RouteTable::new(&setup.ros2, setup.keys.root(), fleet.streams());
        if setup.zenoh_config.is_none() {
            table.close_access_list();
        }
        let sessions = |shares| {
            Sessions::new(shares, fleet.clone(), clock.clone()).within(setup.session_memory)
        };
        let opened = session::open(&setup, &ros2::access::rules(&table), sessions).await?;
        let session = opened.session.clone();
        let stop = CancellationToken::new();
        let parts = Parts {
            keys: setup.keys.clone(),
            gate: Gate::new(setup.membership.clone(), clock.clone()),
            questions: Questions::new(fleet.clone()),
            session,
            fleet,
            lifecycle,
            clock,
            stop,
        };
        parts.linked(table, setup, opened).await
    }

    /// True if the session is open.
    pub fn is_open(&self) -> bool {
        !self.session.is_closed()
    }

    /// Stops receiving messages, then closes the session.
    pub fn close(self) -> Boxed<()> {
        Box::pin(self.closed())
    }

    async fn closed(self) {
        self.stop.cancel();
        if let Some(declared) = self.all {
            declared.undeclare().await;
        }
        if let Some(cluster) = self.cluster {
            cluster.close().await;
        }
        for undeclared in [
            self.presence.undeclare().await,
            self.progress.undeclare().await,
        ] {
            warn_if_refused(undeclared);
        }
        for descriptions in self.descriptions {
            warn_if_refused(descriptions.undeclare().await);
        }
        self.ros2.close().await;
        if let Err(error) = self.publisher.await {
            tracing::error!(%error, "the publisher of estimates failed");
        }
        if let Err(error) = self.poster.await {
            tracing::error!(%error, "the sender of calibrations failed");
        }
        session::close(self.session, self.runtime).await;
    }
}

impl AllRobots {
    async fn undeclare(self) {
        let declared = self.declared;
        for undeclared in [
            self.token.undeclare().await,
            declared.streams.undeclare().await,
            declared.approved.undeclare().await,
            declared.confirmed.undeclare().await,
            declared.answers.undeclare().await,
        ] {
            warn_if_refused(undeclared);
        }
    }
}

/// Context of every part of the link.
#[derive(Debug, Clone)]
struct Parts {
    session: Session,
    keys: Keys,
    fleet: FleetHandle,
    lifecycle: Lifecycle,
    clock: SharedClock,
    gate: Gate,
    questions: Questions,
    stop: CancellationToken,
}

impl Parts {
    async fn linked(
        self,
        table: RouteTable,
        setup: LinkSetup,
        opened: Opened,
    ) -> Result<Link, LinkError> {
        let (session, keys, fleet) = (&self.session, &self.keys, &self.fleet);
        let cluster = setup.membership.cluster().cloned();
        let presence = ingest::watch_presence(session, keys, fleet.clone())
            .await
            .map_err(refused("the subscriber of liveliness tokens"))?;
        let descriptions = description::subscribe(session, keys, fleet)
            .await
            .map_err(refused("the subscribers of robots' descriptions"))?;
        let progress = outgoing::answer_progress(session, keys, fleet.clone(), self.gate.clone())
            .await
            .map_err(refused("the queryable of progress"))?;
        let streams = match &cluster {
            None => Some(self.declare_for_all().await?),
            Some(_) => None,
        };
        let heard = cluster.is_some().then(|| HeardStreams::new(&self));
        let surroundings = ros2::Surroundings {
            fleet: fleet.clone(),
            lifecycle: self.lifecycle.clone(),
            clock: self.clock.clone(),
            questions: self.questions.clone(),
            gate: self.gate.clone(),
            heard,
        };
        let ros2 = Ros2Link::open(session, table, surroundings, self.stop.clone())
            .await
            .map_err(refused("what ROS 2 robots need"))?;
        // Last: a robot that sees the token finds everything else there.
        let all = match streams {
            Some(streams) => Some(self.declare_token(streams).await?),
            None => None,
        };
        let cluster = match cluster {
            Some(cluster) => {
                let parts = ClusterParts {
                    parts: self.clone(),
                    cluster,
                    listens: opened.listens,
                    report: setup.report,
                };
                let opened = ClusterLink::open(parts).await;
                Some(opened.map_err(refused("what instances tell each other"))?)
            }
            None => None,
        };
        let (publisher, poster) = self.begin_to_send(ros2.shared());
        Ok(Link {
            session: self.session,
            runtime: opened.runtime,
            presence,
            descriptions,
            progress,
            all,
            cluster,
            ros2,
            publisher,
            poster,
            stop: self.stop,
        })
    }

    /// Declares everything that serves all robots.
    async fn declare_for_all(&self) -> Result<DeclaredForAll, LinkError> {
        let (session, keys) = (&self.session, &self.keys);
        let asked = calibration::Asked {
            session,
            keys,
            lifecycle: &self.lifecycle,
            questions: &self.questions,
            complete: true,
        };
        let approved = calibration::answer_approved(&asked)
            .await
            .map_err(refused("the queryable of approved calibrations"))?;
        let confirmed = calibration::answer_confirmed(&asked)
            .await
            .map_err(refused("the queryable of confirmations"))?;
        let key = keys.stream_of_all(StreamKind::CalibrationApplied);
        let (lifecycle, gate) = (self.lifecycle.clone(), self.gate.clone());
        let answers = answers::hear(session, keys, key, lifecycle, gate)
            .await
            .map_err(refused("the subscriber of robots' answers"))?;
        let key = keys.stream_of_all_kinds();
        let streams = ingest::subscribe(session, keys, key, self.fleet.clone())
            .await
            .map_err(refused("the subscriber of robots' streams"))?;
        Ok(DeclaredForAll {
            streams,
            approved,
            confirmed,
            answers,
        })
    }

    async fn declare_token(&self, declared: DeclaredForAll) -> Result<AllRobots, LinkError> {
        let instance = ServiceInstance::parse(&self.session.zid().to_string())?;
        let token = self
            .session
            .liveliness()
            .declare_token(self.keys.service(&instance))
            .await
            .map_err(refused("the service's liveliness token"))?;
        Ok(AllRobots { token, declared })
    }

    fn begin_to_send(&self, ros2: Ros2) -> (JoinHandle<()>, JoinHandle<()>) {
        let parts = self.clone();
        let post = calibration::Post {
            session: parts.session,
            keys: parts.keys,
            lifecycle: parts.lifecycle,
            ros2,
            gate: parts.gate,
        };
        let poster = tokio::spawn(post.send_outbox(parts.stop));
        let parts = self.clone();
        let publishing = outgoing::publish_estimates(
            parts.session,
            parts.keys,
            parts.fleet,
            parts.gate,
            parts.stop,
        );
        (tokio::spawn(publishing), poster)
    }
}

fn refused(what: &'static str) -> impl Fn(zenoh::Error) -> LinkError {
    move |error| LinkError::Declare {
        what,
        reason: error.to_string(),
    }
}

fn warn_if_refused(undeclared: zenoh::Result<()>) {
    if let Err(error) = undeclared {
        tracing::warn!(error, "Zenoh refused to undeclare");
    }
}
