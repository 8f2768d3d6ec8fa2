//! The whole service in one value: what `serve` runs, and `demo` runs beside its robots.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::Arc;

use fleetcal_api::{AccessSetup, ApiSetup, BuildInfo, router, serve};
use fleetcal_clock::SharedClock;
use fleetcal_cluster::Membership;
use fleetcal_config::Config;
use fleetcal_domain::access::{Actor, SetupCode};
use fleetcal_domain::limits;
use fleetcal_domain::robot::{CrossTrack, RobotConfig};
use fleetcal_fleet::{FleetHandle, FleetSetup};
use fleetcal_folder::signing_key::{self, KeyError};
use fleetcal_http::Connections;
use fleetcal_http::PublicUrl;
use fleetcal_link::{Link, LinkError, LinkSetup};
use fleetcal_model::{Generation, WallTime};
use fleetcal_operations::accounts::KeepSetupCode;
use fleetcal_operations::alert_evaluator::{AlertEvaluator, AlertEvaluatorSetup};
use fleetcal_operations::entropy::{self, NoEntropy};
use fleetcal_operations::lifecycle::{Lifecycle, LifecycleSetup};
use fleetcal_operations::peers::Peers;
use fleetcal_operations::robots::configure;
use fleetcal_operations::webhook_dispatcher::{WebhookDispatcher, WebhookDispatcherSetup};
use fleetcal_proto::{Keys, RobotId};
use fleetcal_store::{Expected, Store, StoreError};
use thiserror::Error;
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use crate::database;

/// What this program was built from. A build says its commit in the variable `FLEETCAL_COMMIT`.
const BUILD: BuildInfo = BuildInfo {
    version: env!("CARGO_PKG_VERSION"),
    commit: match option_env!("FLEETCAL_COMMIT") {
        Some(commit) => commit,
        None => "unknown",
    },
};

/// Why the service could not be started.
#[derive(Debug, Error)]
pub enum ServiceError {
    /// Its HTTP address cannot be listened on.
    #[error("cannot listen on {address} for HTTP: {source}")]
    Http {
        /// The address.
        address: SocketAddr,
        /// What the system says.
        source: std::io::Error,
    },
    /// Its store cannot be opened or read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// There is no signing key.
    #[error(transparent)]
    Key(#[from] KeyError),
    /// Zenoh cannot be opened.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The system has no randomness.
    #[error("the system gives no random bytes: {0}")]
    Entropy(#[from] NoEntropy),
    /// More robots are configured than there is room for.
    #[error(
        "{configured} robots are configured, expected {} at most",
        limits::ROBOTS_MAX
    )]
    TooManyRobots {
        /// How many there are.
        configured: usize,
    },
}

/// The running service.
#[derive(Debug)]
pub struct Service {
    fleet: FleetHandle,
    lifecycle: Lifecycle,
    evaluator: AlertEvaluator,
    dispatcher: WebhookDispatcher,
    store: Store,
    link: Link,
    link_open: watch::Sender<bool>,
    http: JoinHandle<()>,
    http_address: SocketAddr,
    public_url: Option<PublicUrl>,
    /// The text of the code that makes the first administrator, while there is nobody.
    setup_code: Option<String>,
    stop: CancellationToken,
}

impl Service {
    /// Starts everything: the store, a task for each robot, the API, and at last the link.
    ///
    /// # Errors
    /// When an address is in use, the store cannot be opened, or Zenoh refuses its configuration.
    pub async fn start(config: Config, clock: SharedClock) -> Result<Self, ServiceError> {
        let link_setup = link_setup(&config);
        link_setup.check()?;
        let refused = |source| ServiceError::Http {
            address: config.http,
            source,
        };
        let listener = fleetcal_http::listen(config.http).map_err(refused)?;
        let http_address = listener.local_addr().map_err(refused)?;
        let store = database::open(&config, Arc::clone(&clock)).await?;
        let fleet = start_fleet(&config, &store, Arc::clone(&clock)).await?;
        let (lifecycle, evaluator, dispatcher) =
            start_workers(&config, &store, &fleet, &clock).await?;
        let stop = CancellationToken::new();
        let (link_open, link_is_open) = watch::channel(false);
        let setup_code = setup_code(&store, clock.now()).await?;
        let connections = Connections::new(Arc::clone(&clock), config.trusted_proxies.clone());
        let routes = router(ApiSetup {
            build: BUILD,
            fleet: fleet.clone(),
            lifecycle: lifecycle.clone(),
            evaluator: evaluator.clone(),
            dispatcher: dispatcher.clone(),
            store: store.clone(),
            clock: Arc::clone(&clock),
            link_open: link_is_open,
            membership: Membership::alone(),
            peers: Peers::default(),
            access: AccessSetup {
                public_url: config.public_url.clone(),
            },
            connections: connections.clone(),
            stop: stop.clone(),
        });
        let serving = serve(listener, routes, connections, stop.clone()).map_err(refused)?;
        let http = tokio::spawn(serving);
        let link = match Link::open(link_setup, fleet.clone(), lifecycle.clone(), clock).await {
            Ok(link) => link,
            Err(error) => {
                stop.cancel();
                evaluator.stop().await;
                dispatcher.stop().await;
                lifecycle.stop().await;
                fleet.stop().await;
                close_store(&store).await;
                return Err(error.into());
            }
        };
        link_open.send_replace(true);
        Ok(Self {
            fleet,
            lifecycle,
            evaluator,
            dispatcher,
            store,
            link,
            link_open,
            http,
            http_address,
            public_url: config.public_url,
            setup_code,
            stop,
        })
    }

    /// Where the API and the dashboard are.
    pub fn http_address(&self) -> SocketAddr {
        self.http_address
    }

    /// Where people reach the API and the dashboard.
    pub fn url(&self) -> String {
        match &self.public_url {
            Some(url) => url.as_str().to_owned(),
            None => format!("http://{}", self.http_address),
        }
    }

    /// The link by which the first administrator is made; `None` once there are users. The code
    /// stands behind the `#`, which browsers do not send.
    pub fn setup_link(&self) -> Option<String> {
        let code = self.setup_code.as_ref()?;
        Some(format!("{}/setup#code={code}", self.url()))
    }

    /// The robots.
    pub fn fleet(&self) -> &FleetHandle {
        &self.fleet
    }

    /// What is kept.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// The life cycle of calibrations.
    pub fn lifecycle(&self) -> &Lifecycle {
        &self.lifecycle
    }

    /// Takes no further message, works through what waits, stores it, and ends.
    ///
    /// # Errors
    /// [`StoreError::RowsLost`] when not everything could be stored, or the database's failure.
    pub async fn stop(self) -> Result<(), StoreError> {
        self.link_open.send_replace(false);
        self.stop.cancel();
        self.link.close().await;
        self.evaluator.stop().await;
        self.dispatcher.stop().await;
        self.lifecycle.stop().await;
        self.fleet.stop().await;
        let closed = self.store.close().await;
        if let Err(error) = self.http.await {
            tracing::error!(%error, "the HTTP server failed");
        }
        closed
    }
}

fn link_setup(config: &Config) -> LinkSetup {
    LinkSetup {
        listen: config.listen.clone(),
        connect: config.connect.clone(),
        zenoh_config: config.zenoh_config.clone(),
        allow_anonymous: config.allow_anonymous,
        keys: Keys::new(config.root.clone()),
        ros2: config.ros2.clone(),
    }
}

/// The text of a new code for the first administrator, when there is no user.
async fn setup_code(store: &Store, now: WallTime) -> Result<Option<String>, ServiceError> {
    if store.has_users().await? {
        return Ok(None);
    }
    let (code, text) = SetupCode::new(&entropy::secret()?, now);
    let counts = store.transact(KeepSetupCode(code)).await?;
    Ok(counts.then_some(text))
}

/// Those who look after the fleet: the lifecycle for its calibrations, the alert evaluator for what is wrong
/// with it, and the webhook dispatcher for who is told of that.
async fn start_workers(
    config: &Config,
    store: &Store,
    fleet: &FleetHandle,
    clock: &SharedClock,
) -> Result<(Lifecycle, AlertEvaluator, WebhookDispatcher), ServiceError> {
    let (key, key_is_new) = signing_key::load_or_make(&config.data, || {
        entropy::secret().map_err(|error| std::io::Error::other(error.to_string()))
    })?;
    let lifecycle = Lifecycle::start(LifecycleSetup {
        store: store.clone(),
        fleet: fleet.clone(),
        clock: Arc::clone(clock),
        policy: config.approval,
        key,
    })
    .await?;
    if key_is_new && lifecycle.has_given_out() {
        tracing::error!(
            folder = %config.data.display(),
            "the signing key was missing and a new one was made: robots refuse what it signs until \
             their agents are given its public half, or the former key is put back"
        );
    }
    let evaluator = AlertEvaluator::start(AlertEvaluatorSetup {
        store: store.clone(),
        fleet: fleet.clone(),
        lifecycle: lifecycle.clone(),
        clock: Arc::clone(clock),
        policy: config.alerts.clone(),
    })
    .await?;
    let dispatcher = WebhookDispatcher::start(WebhookDispatcherSetup {
        store: store.clone(),
        clock: Arc::clone(clock),
        jitter: entropy::jitter,
    });
    Ok((lifecycle, evaluator, dispatcher))
}

async fn close_store(store: &Store) {
    if let Err(error) = store.close().await {
        tracing::error!(%error, "the store did not close");
    }
}

/// The fleet as it was stored, and as the configuration file has it: of a robot that is in both,
/// the file's vehicle counts.
async fn start_fleet(
    config: &Config,
    store: &Store,
    clock: SharedClock,
) -> Result<FleetHandle, ServiceError> {
    let mut robots: BTreeMap<RobotId, RobotConfig> = BTreeMap::new();
    for record in store.load_robots().await? {
        if let Some(stored) = record.config {
            robots.insert(record.id, stored);
        }
    }
    for entry in &config.robots {
        let mut wanted = entry.config.clone();
        if let Some(stored) = robots.get(&entry.id) {
            wanted.streams.keep_former_topic(&stored.streams);
        }
        if robots.get(&entry.id) != Some(&wanted) {
            let actor = Actor::service();
            configure(store, &entry.id, &wanted, Expected::Any, actor).await?;
            robots.insert(entry.id.clone(), wanted);
        }
    }
    if robots.len() > limits::ROBOTS_MAX {
        return Err(ServiceError::TooManyRobots {
            configured: robots.len(),
        });
    }
    let mut cross_tracks: BTreeMap<RobotId, BTreeMap<Generation, CrossTrack>> = BTreeMap::new();
    for record in store.load_cross_tracks().await? {
        let of_robot = cross_tracks.entry(record.robot).or_default();
        of_robot.insert(record.generation, record.errors);
    }
    let checkpoints = store.load_checkpoints().await?;
    let checkpoints = checkpoints
        .into_iter()
        .map(|record| (record.robot, record.state))
        .collect();
    let last_heard = store.load_current().await?;
    let last_heard = last_heard
        .into_iter()
        .map(|record| (record.estimate.robot, record.received_ns))
        .collect();
    Ok(FleetHandle::start(FleetSetup {
        clock,
        journal: Arc::new(store.clone()),
        estimator: config.estimator.clone(),
        robots,
        cross_tracks,
        checkpoints,
        last_heard,
        membership: fleetcal_cluster::Membership::alone(),
    }))
}
