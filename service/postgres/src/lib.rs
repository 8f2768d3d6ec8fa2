//! The store's database in PostgreSQL, on one server or on several of which one can be written.
//!
//! Jobs run in serializable transactions of their own, and are run again when PostgreSQL could not
//! bring them into an order with others. Telemetry has a connection of its own, whose commits wait
//! for the server's disk and for no standby. Every statement has a time limit here; the connection that decides has
//! none at the server, because a commit that is cancelled there may have been made.

mod advisory;
mod cluster;
mod connection;
mod copy;
mod failure;
mod history;
mod line;
mod old_days;
mod schema;
mod servers;
mod testing;
mod writer;

use std::path::PathBuf;
use std::pin::Pin;
use std::sync::Arc;

use fleetcal_clock::SharedClock;
use fleetcal_cluster::InstanceId;
use fleetcal_sql::{SqlReader, telemetry};
use fleetcal_store::backend::Database;
use fleetcal_store::cluster::ClusterRegistry;
use fleetcal_store::database_url::PostgresUrl;
use fleetcal_store::{Administration, Store, StoreError};

use advisory::{AdvisoryLock, Locked};
use cluster::{Fence, Registry};
use history::History;
use servers::{Purpose, Servers};
use writer::{Records, Telemetry};

pub use cluster::Fencing;
pub use copy::copy;
pub use schema::migrate;
#[doc(hidden)]
pub use testing::{create_for_test, fill_day_for_test, spent_for_test};
pub use writer::JobRuns;

/// Future that is compiled in this crate instead of each that awaits it.
pub type Boxed<'a, T> = Pin<Box<dyn Future<Output = T> + Send + 'a>>;

/// Address and password of the database.
#[derive(Debug, Clone)]
pub struct PostgresSetup {
    /// Address of the database.
    pub url: PostgresUrl,
    /// File whose first line is the password; without one, `PGPASSFILE` applies.
    pub password_file: Option<PathBuf>,
}

/// The database of a running service.
#[derive(Debug)]
struct Open {
    servers: Arc<Servers>,
    /// Newest migration when it was opened: this program's, or a newer one that it may use.
    schema: i64,
    /// Registry of a cluster instance.
    registry: Option<Arc<Registry>>,
    /// Guard that lives as long as the store.
    _held: Box<dyn std::fmt::Debug + Send + Sync>,
}

impl Database for Open {
    fn schema_known(&self) -> i64 {
        self.schema
    }

    fn write_once(&self) -> Boxed<'static, Result<(), StoreError>> {
        let servers = Arc::clone(&self.servers);
        Box::pin(async move { servers.write_once().await })
    }

    fn registry(&self) -> Option<Arc<dyn ClusterRegistry>> {
        let registry = self.registry.as_ref().map(Arc::clone);
        registry.map(|registry| registry as _)
    }
}

/// Opens the store, which no other service may have open, and migrates the database to this
/// program's schema. `held` is dropped with the store.
///
/// # Errors
/// [`StoreError::Server`] if no server can be used or another service has it open,
/// [`StoreError::NewerSchema`] if a newer program wrote the database, or another error of opening
/// it.
pub fn open(
    setup: PostgresSetup,
    held: Box<dyn std::fmt::Debug + Send + Sync>,
    clock: SharedClock,
) -> Boxed<'static, Result<Store, StoreError>> {
    open_with(setup, held, clock, JobRuns::Once, Sharing::Alone)
}

/// Opens the store for an instance of a cluster, beside other instances but not beside a service
/// that is alone. It has no robots yet: rows of a robot are written once the store's claims have
/// its tenure. `held` is dropped with the store.
///
/// # Errors
/// As [`open`].
pub fn open_instance(
    setup: PostgresSetup,
    held: Box<dyn std::fmt::Debug + Send + Sync>,
    clock: SharedClock,
    instance: InstanceId,
) -> Boxed<'static, Result<Store, StoreError>> {
    let sharing = Sharing::Instance(instance, Fencing::Locked);
    open_with(setup, held, clock, JobRuns::Once, sharing)
}

/// Other processes that may have a database open.
#[derive(Debug, Clone, PartialEq, Eq)]
#[doc(hidden)]
pub enum Sharing {
    /// One service alone.
    Alone,
    /// Instances of a cluster, including this one.
    Instance(InstanceId, Fencing),
    /// Any others, for tests.
    WithOthers,
}

impl Sharing {
    fn lock(&self) -> Option<AdvisoryLock> {
        match self {
            Self::Alone => Some(AdvisoryLock::new(Locked::Alone)),
            Self::Instance(..) => Some(AdvisoryLock::new(Locked::Beside)),
            Self::WithOthers => None,
        }
    }
}

/// Opens the store with jobs that may be run twice, and beside others.
///
/// # Errors
/// As [`open`].
#[doc(hidden)]
pub fn open_with(
    setup: PostgresSetup,
    held: Box<dyn std::fmt::Debug + Send + Sync>,
    clock: SharedClock,
    jobs: JobRuns,
    sharing: Sharing,
) -> Boxed<'static, Result<Store, StoreError>> {
    Box::pin(async move {
        let servers = Arc::new(Servers::new(setup)?);
        let schema = schema::bring(&servers).await?;
        let records = servers.session(Purpose::Records).await?;
        let mut telemetry = servers.session(Purpose::Telemetry).await?;
        let mut lock = sharing.lock();
        if let Some(lock) = &mut lock {
            lock.take(&servers, &mut telemetry).await?;
        }
        let (history, fence, registry) = match sharing {
            Sharing::Instance(instance, fencing) => {
                let registry = Registry::new(Arc::clone(&servers), &instance);
                let fence = Fence::new(instance, fencing);
                (History::new(), Some(fence), Some(Arc::new(registry)))
            }
            Sharing::Alone | Sharing::WithOthers => {
                telemetry::note_start(&mut telemetry, clock.now()).await?;
                (History::open(&mut telemetry).await?, None, None)
            }
        };
        let reader = SqlReader::new(servers.read_pool().await?);
        let database = Arc::new(Open {
            servers: Arc::clone(&servers),
            schema,
            registry,
            _held: held,
        });
        Ok(Store::start(
            Records::new(Arc::clone(&servers), records, jobs),
            Telemetry::new(servers, telemetry, history, lock, fence),
            reader,
            database,
            clock,
        ))
    })
}

/// Opens the database for administration. The schema must be one that this program may use.
///
/// # Errors
/// [`StoreError::Server`] if no server can be used, [`StoreError::OtherSchema`] if the database has
/// another schema.
pub fn administration(setup: PostgresSetup) -> Boxed<'static, Result<Administration, StoreError>> {
    Box::pin(async move {
        let servers = Arc::new(Servers::new(setup)?);
        let mut records = servers.session(Purpose::Records).await?;
        let found = schema::found(&mut records).await?.unwrap_or(0);
        if !schema::may_use(&mut records, found).await? {
            let known = schema::known();
            return Err(StoreError::OtherSchema { found, known });
        }
        let reader = SqlReader::new(servers.read_pool().await?);
        let writer = Records::new(servers, records, JobRuns::Once);
        Ok(Administration::new(writer, reader, None))
    })
}
