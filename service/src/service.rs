//! The whole service in one value: what `serve` runs, and `demo` runs beside its robots.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

use fleetcal_api::{AccessSetup, ApiSetup, BuildInfo, router, serve};
use fleetcal_clock::SharedClock;
use fleetcal_cluster::{InstanceId, LinkReport, Membership};
use fleetcal_config::Config;
use fleetcal_domain::access::{Actor, SetupCode};
use fleetcal_domain::limits;
use fleetcal_domain::robot::{CrossTrack, RobotConfig};
use fleetcal_fleet::{FleetHandle, FleetSetup};
use fleetcal_folder::signing_key::{self, KeyError};
use fleetcal_http::Connections;
use fleetcal_http::{PublicUrl, SecurityContacts};
use fleetcal_link::{Link, LinkError, LinkSetup, SessionMemory, Shares};
use fleetcal_model::{AuditId, Generation, WallTime};
use fleetcal_moments::Moments;
use fleetcal_operations::accounts::KeepSetupCode;
use fleetcal_operations::alert_evaluator::{AlertEvaluator, AlertEvaluatorSetup};
use fleetcal_operations::entropy::{self, NoEntropy};
use fleetcal_operations::following::{Following, FollowingSetup};
use fleetcal_operations::lifecycle::{Lifecycle, LifecycleSetup};
use fleetcal_operations::ownership::{Ownership, OwnershipSetup};
use fleetcal_operations::peers::PeersError;
use fleetcal_operations::robots::configure;
use fleetcal_operations::webhook_dispatcher::{WebhookDispatcher, WebhookDispatcherSetup};
use fleetcal_proto::{Keys, RobotId};
use fleetcal_store::{Expected, Store, StoreError};
use thiserror::Error;
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use crate::{cluster, database, memory};

/// Version and commit of this program; a build sets the commit in the variable `FLEETCAL_COMMIT`.
const BUILD: BuildInfo = BuildInfo {
    version: env!("CARGO_PKG_VERSION"),
    commit: match option_env!("FLEETCAL_COMMIT") {
        Some(commit) => commit,
        None => "unknown",
    },
};

/// Reason for which the service could not be started.
#[derive(Debug, Error)]
pub enum ServiceError {
    /// The HTTP address cannot be listened on.
    #[error("cannot listen on {address} for HTTP: {source}")]
    Http {
        /// The address.
        address: SocketAddr,
        /// Error of the system.
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
    /// An instance has no shared database.
    #[error(
        "cluster.instance: got {}, expected none without a database that several can share: name \
         it with --database postgres://…",
        instance.as_str()
    )]
    NothingShared {
        /// The instance.
        instance: InstanceId,
    },
    /// The certificates by which peers are authenticated cannot be used.
    #[error(transparent)]
    Peers(#[from] PeersError),
    /// The moments of the data folder cannot be read.
    #[error("{}: the moments of robots: {source}", folder.display())]
    Moments {
        /// The data folder.
        folder: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// More robots are configured than there is room for.
    #[error(
        "{configured} robots are configured, expected {} at most",
        limits::ROBOTS_MAX
    )]
    TooManyRobots {
        /// Number of configured robots.
        configured: usize,
    },
}

/// The running service.
#[derive(Debug)]
pub struct Service {
    fleet: FleetHandle,
    workers: Workers,
    store: Store,
    link: Link,
    link_open: watch::Sender<bool>,
    http: JoinHandle<()>,
    http_address: SocketAddr,
    public_url: Option<PublicUrl>,
    /// Text of the code that makes the first administrator, while there are no users.
    setup_code: Option<String>,
    /// Its place in the cluster, and the follower of the other instances.
    part: Option<(Ownership, Following)>,
    stop: CancellationToken,
}

impl Service {
    /// Starts everything: the store, a task for each robot, the API, and at last the link.
    ///
    /// # Errors
    /// An address is in use, the store cannot be opened, or Zenoh refuses its configuration.
    pub async fn start(config: Config, clock: SharedClock) -> Result<Self, ServiceError> {
        let link_setup = link_setup(&config)?;
        let membership = link_setup.membership.clone();
        let refused = http_refused(config.http);
        let listener = fleetcal_http::listen(config.http).map_err(refused)?;
        let http_address = listener.local_addr().map_err(refused)?;
        let store = database::open(&config, Arc::clone(&clock)).await?;
        // Before anything is read: what others decide from here on is followed.
        let last_decided = store.audit_last().await?;
        let fleet = start_fleet(&config, &store, &membership, Arc::clone(&clock)).await?;
        let workers = start_workers(&config, &store, &fleet, &membership, &clock).await?;
        let moments = start_moments(&config, &fleet, &clock)?;
        let stop = CancellationToken::new();
        let peers = cluster::peers(&config, http_address, stop.clone())?;
        let part = Part {
            store: &store,
            fleet: &fleet,
            workers: &workers,
            membership: &membership,
            clock: &clock,
            report: link_setup.report.subscribe(),
        };
        let part = part.join(&config, http_address, last_decided).await?;
        let (link_open, link_is_open) = watch::channel(false);
        let setup_code = setup_code(&store, clock.now()).await?;
        let connections = Connections::new(Arc::clone(&clock), config.trusted_proxies.clone());
        let routes = router(ApiSetup {
            build: BUILD,
            fleet: fleet.clone(),
            lifecycle: workers.lifecycle.clone(),
            evaluator: workers.evaluator.clone(),
            dispatcher: workers.dispatcher.clone(),
            moments,
            store: store.clone(),
            clock: Arc::clone(&clock),
            link_open: link_is_open,
            access: AccessSetup {
                public_url: config.public_url.clone(),
            },
            security_contacts: security_contacts(&config),
            connections: connections.clone(),
            membership,
            peers,
            stop: stop.clone(),
        });
        let serving = serve(listener, routes, connections, stop.clone()).map_err(refused)?;
        let http = tokio::spawn(serving);
        let lifecycle = workers.lifecycle.clone();
        let link = match Link::open(link_setup, fleet.clone(), lifecycle, clock).await {
            Ok(link) => link,
            Err(error) => {
                stop.cancel();
                end_without_link(part, &workers, &fleet, &store).await;
                return Err(error.into());
            }
        };
        link_open.send_replace(true);
        Ok(Self {
            fleet,
            workers,
            store,
            link,
            link_open,
            http,
            http_address,
            public_url: config.public_url,
            setup_code,
            part,
            stop,
        })
    }

    /// Hands its robots over to the other instances, if there are any.
    pub async fn leave_cluster(&self) {
        if let Some((ownership, _)) = &self.part {
            ownership.leave().await;
        }
    }

    /// Returns the address of the API and the dashboard.
    pub fn http_address(&self) -> SocketAddr {
        self.http_address
    }

    /// Returns the public URL of the API and the dashboard.
    pub fn url(&self) -> String {
        match &self.public_url {
            Some(url) => url.as_str().to_owned(),
            None => format!("http://{}", self.http_address),
        }
    }

    /// Returns the link by which the first administrator is made; `None` once there are users. The
    /// code follows the `#`, which browsers do not send.
    pub fn setup_link(&self) -> Option<String> {
        let code = self.setup_code.as_ref()?;
        Some(format!("{}/setup#code={code}", self.url()))
    }

    /// Returns the fleet.
    pub fn fleet(&self) -> &FleetHandle {
        &self.fleet
    }

    /// Returns the store.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// Returns the life cycle of calibrations.
    pub fn lifecycle(&self) -> &Lifecycle {
        &self.workers.lifecycle
    }

    /// Stops receiving, processes and stores the waiting messages, and ends.
    ///
    /// # Errors
    /// [`StoreError::RowsLost`] if some rows could not be stored, or the database's failure.
    pub async fn stop(self) -> Result<(), StoreError> {
        self.link_open.send_replace(false);
        self.stop.cancel();
        self.link.close().await;
        if let Some((_, following)) = &self.part {
            following.stop().await;
        }
        self.workers.stop().await;
        self.fleet.stop().await;
        let closed = self.store.close().await;
        if let Err(error) = self.http.await {
            tracing::error!(%error, "the HTTP server failed");
        }
        closed
    }
}

/// Makes the contents of `security.txt`.
fn security_contacts(config: &Config) -> SecurityContacts {
    SecurityContacts {
        contacts: config.security_contacts.clone(),
        url: config.public_url.clone(),
    }
}

/// Returns the error of an HTTP address that cannot be used.
fn http_refused(address: SocketAddr) -> impl Fn(io::Error) -> ServiceError + Copy {
    move |source| ServiceError::Http { address, source }
}

fn start_moments(
    config: &Config,
    fleet: &FleetHandle,
    clock: &SharedClock,
) -> Result<Moments, ServiceError> {
    let moments = Moments::start(&config.data, fleet.clone(), Arc::clone(clock));
    moments.map_err(|source| ServiceError::Moments {
        folder: config.data.clone(),
        source,
    })
}

/// Makes the largest numbers of Zenoh sessions.
fn shares(config: &Config) -> Shares {
    let configured = Shares {
        of_name: config.sessions_per_name,
        of_address: config.sessions_per_address,
        ..Shares::default()
    };
    match (config.sessions_without_name, memory::allowed_bytes()) {
        (Some(nameless), _) => Shares {
            nameless,
            ..configured
        },
        (None, Some(bytes)) => configured.within_memory(bytes),
        (None, None) => configured,
    }
}

/// Returns the memory that Zenoh sessions are closed by; `None` where the system does not say it.
fn session_memory() -> Option<SessionMemory> {
    let allowed_bytes = memory::allowed_bytes()?;
    Some(SessionMemory {
        resident: memory::resident_bytes,
        allowed_bytes,
    })
}

/// Makes the link's setup, and checks it before anything is opened.
fn link_setup(config: &Config) -> Result<LinkSetup, ServiceError> {
    if let (Some(instance), None) = (&config.cluster.instance, &config.database) {
        let instance = instance.clone();
        return Err(ServiceError::NothingShared { instance });
    }
    let instance = config.cluster.instance.clone();
    let setup = LinkSetup {
        membership: instance.map_or_else(Membership::alone, Membership::of),
        listen: config.listen.clone(),
        connect: config.connect.clone(),
        zenoh_config: config.zenoh_config.clone(),
        allow_anonymous: config.allow_anonymous,
        shares: shares(config),
        session_memory: session_memory(),
        keys: Keys::new(config.root.clone()),
        ros2: config.ros2.clone(),
        ..LinkSetup::default()
    };
    setup.check()?;
    Ok(setup)
}

/// Makes the text of a new code for the first administrator, if there are no users.
async fn setup_code(store: &Store, now: WallTime) -> Result<Option<String>, ServiceError> {
    if store.has_users().await? {
        return Ok(None);
    }
    let (code, text) = SetupCode::new(&entropy::secret()?, now);
    let counts = store.transact(KeepSetupCode(code)).await?;
    Ok(counts.then_some(text))
}

/// Background workers: the lifecycle for calibrations, the alert evaluator for faults of the fleet,
/// and the webhook dispatcher for the messages about them.
#[derive(Debug)]
struct Workers {
    lifecycle: Lifecycle,
    evaluator: AlertEvaluator,
    dispatcher: WebhookDispatcher,
}

impl Workers {
    async fn stop(&self) {
        self.evaluator.stop().await;
        self.dispatcher.stop().await;
        self.lifecycle.stop().await;
    }
}

/// Context in which an instance joins the cluster.
struct Part<'a> {
    store: &'a Store,
    fleet: &'a FleetHandle,
    workers: &'a Workers,
    membership: &'a Membership,
    clock: &'a SharedClock,
    report: watch::Receiver<LinkReport>,
}

impl Part<'_> {
    /// Joins the cluster, and follows the decisions of others after `last_decided`; `None` for a
    /// service that is alone.
    async fn join(
        self,
        config: &Config,
        http: SocketAddr,
        last_decided: AuditId,
    ) -> Result<Option<(Ownership, Following)>, ServiceError> {
        let lifecycle = &self.workers.lifecycle;
        let ownership = Ownership::start(OwnershipSetup {
            store: self.store.clone(),
            fleet: self.fleet.clone(),
            lifecycle: lifecycle.clone(),
            membership: self.membership.clone(),
            clock: Arc::clone(self.clock),
            joining: cluster::joining(config, lifecycle, http),
            link: self.report,
            fast_takeover: config.cluster.fast_takeover,
            draw: entropy::number,
        });
        let Some(ownership) = ownership.await? else {
            return Ok(None);
        };
        let following = FollowingSetup {
            store: self.store.clone(),
            fleet: self.fleet.clone(),
            lifecycle: lifecycle.clone(),
            evaluator: self.workers.evaluator.clone(),
            membership: self.membership.clone(),
        };
        Ok(Some((ownership, Following::start(following, last_decided))))
    }
}

async fn start_workers(
    config: &Config,
    store: &Store,
    fleet: &FleetHandle,
    membership: &Membership,
    clock: &SharedClock,
) -> Result<Workers, ServiceError> {
    let draw = || entropy::secret().map_err(|error| std::io::Error::other(error.to_string()));
    let (keys, key_is_new) = match &config.cluster.signing_key {
        Some(path) => signing_key::load_or_make_at(path, draw)?,
        None => signing_key::load_or_make(&config.data, draw)?,
    };
    let lifecycle = Lifecycle::start(LifecycleSetup {
        store: store.clone(),
        fleet: fleet.clone(),
        clock: Arc::clone(clock),
        policy: config.approval,
        keys,
        membership: membership.clone(),
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
        membership: membership.clone(),
    })
    .await?;
    let dispatcher = WebhookDispatcher::start(WebhookDispatcherSetup {
        store: store.clone(),
        clock: Arc::clone(clock),
        jitter: entropy::jitter,
        membership: membership.clone(),
    });
    Ok(Workers {
        lifecycle,
        evaluator,
        dispatcher,
    })
}

/// Ends everything that was started before the link could not be opened.
async fn end_without_link(
    part: Option<(Ownership, Following)>,
    workers: &Workers,
    fleet: &FleetHandle,
    store: &Store,
) {
    if let Some((ownership, following)) = part {
        following.stop().await;
        ownership.leave().await;
    }
    workers.stop().await;
    fleet.stop().await;
    close_store(store).await;
}

async fn close_store(store: &Store) {
    if let Err(error) = store.close().await {
        tracing::error!(%error, "the store did not close");
    }
}

/// Returns the errors beside the path of every robot, by the calibration in use.
async fn cross_tracks(
    store: &Store,
) -> Result<BTreeMap<RobotId, BTreeMap<Generation, CrossTrack>>, StoreError> {
    let mut cross_tracks: BTreeMap<RobotId, BTreeMap<_, _>> = BTreeMap::new();
    for record in store.load_cross_tracks().await? {
        let of_robot = cross_tracks.entry(record.robot).or_default();
        of_robot.insert(record.generation, record.errors);
    }
    Ok(cross_tracks)
}

/// Starts the fleet from the store and the configuration file: for a robot in both, the file's
/// vehicle applies; with several instances, the stored one.
async fn start_fleet(
    config: &Config,
    store: &Store,
    membership: &Membership,
    clock: SharedClock,
) -> Result<FleetHandle, ServiceError> {
    // Before the rest: later notes are brought to the estimators.
    let audited = store.audit_last().await?;
    let mut robots: BTreeMap<RobotId, RobotConfig> = BTreeMap::new();
    for record in store.load_robots().await? {
        if let Some(stored) = record.config {
            robots.insert(record.id, stored);
        }
    }
    let ids = config.robots.iter().map(|entry| &entry.id);
    let configured = ids.chain(robots.keys()).collect::<BTreeSet<_>>().len();
    if configured > limits::ROBOTS_MAX {
        return Err(ServiceError::TooManyRobots { configured });
    }
    let are_several = membership.cluster().is_some();
    for entry in &config.robots {
        if are_several && robots.contains_key(&entry.id) {
            continue;
        }
        let mut wanted = entry.config.clone();
        if let Some(stored) = robots.get(&entry.id) {
            wanted.streams.keep_former_topic(&stored.streams);
        }
        if robots.get(&entry.id) != Some(&wanted) {
            let actor = Actor::service();
            let expected = if are_several {
                Expected::Absent
            } else {
                Expected::Any
            };
            match configure(store, &entry.id, &wanted, expected, actor).await {
                // Another instance was faster: it is followed.
                Err(StoreError::VersionConflict { .. }) if are_several => {}
                done => drop(done?),
            }
            robots.insert(entry.id.clone(), wanted);
        }
    }
    let cross_tracks = cross_tracks(store).await?;
    // An instance reads those of the robots that it gets.
    let checkpoints = if are_several {
        Vec::new()
    } else {
        store.load_checkpoints().await?
    };
    let checkpoints = checkpoints
        .into_iter()
        .map(|record| (record.robot, record.state))
        .collect();
    let last_heard = store.load_current().await?;
    let last_heard = last_heard
        .into_iter()
        .map(|record| (record.estimate.robot, record.received_ns))
        .collect();
    let fleet = FleetHandle::start(FleetSetup {
        clock,
        journal: Arc::new(store.clone()),
        estimator: config.estimator.clone(),
        robots,
        cross_tracks,
        checkpoints,
        last_heard,
        membership: membership.clone(),
        audited,
    });
    if let Some(bytes) = memory::allowed_bytes() {
        fleet.limit_latest_data(bytes);
    }
    Ok(fleet)
}
