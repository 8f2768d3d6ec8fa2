//! The store's database in PostgreSQL, on one server or on several of which one can be written.
//!
//! Jobs run in serializable transactions of their own, and are run again when PostgreSQL could not
//! bring them into an order with others. Telemetry has a connection of its own, whose commits do
//! not wait for the disk. Every statement has a time limit here; the connection that decides has
//! none at the server, because a commit that is cancelled there may have been made.

mod connection;
mod copy;
mod exclusive;
mod failure;
mod history;
mod old_days;
mod schema;
mod servers;
mod testing;
mod writer;

use std::path::PathBuf;
use std::pin::Pin;
use std::sync::Arc;

use fleetcal_clock::SharedClock;
use fleetcal_sql::{SqlReader, telemetry};
use fleetcal_store::backend::Database;
use fleetcal_store::database_url::PostgresUrl;
use fleetcal_store::{Administration, Store, StoreError};

use connection::Session;
use exclusive::ExclusiveLock;
use history::History;
use servers::{Purpose, Servers};
use writer::{Records, Telemetry};

pub use copy::copy;
pub use schema::migrate;
#[doc(hidden)]
pub use testing::{create_for_test, fill_day_for_test, spent_for_test};
pub use writer::JobRuns;

/// A future that is compiled in this crate, and not in each that awaits it.
pub type Boxed<'a, T> = Pin<Box<dyn Future<Output = T> + Send + 'a>>;

/// Where the database is, and the password.
#[derive(Debug, Clone)]
pub struct PostgresSetup {
    /// Where it is.
    pub url: PostgresUrl,
    /// The file whose first line is the password; without one, `PGPASSFILE` counts.
    pub password_file: Option<PathBuf>,
}

/// The database of a running service.
#[derive(Debug)]
struct Open {
    servers: Arc<Servers>,
    /// Held as long as the store.
    _held: Box<dyn std::fmt::Debug + Send + Sync>,
}

impl Database for Open {
    fn schema_known(&self) -> i64 {
        schema::known()
    }

    fn write_once(&self) -> Boxed<'static, Result<(), StoreError>> {
        let servers = Arc::clone(&self.servers);
        Box::pin(async move { servers.write_once().await })
    }
}

/// Opens the store, which no other service may have open, and brings the database to this program's
/// schema. `held` goes with the store.
///
/// # Errors
/// [`StoreError::Server`] when no server can be used or another service has it open, [`StoreError::NewerSchema`] when a newer
/// program wrote the database, and whatever else keeps it from being opened.
pub fn open(
    setup: PostgresSetup,
    held: Box<dyn std::fmt::Debug + Send + Sync>,
    clock: SharedClock,
) -> Boxed<'static, Result<Store, StoreError>> {
    open_with(setup, held, clock, JobRuns::Once, Sharing::Alone)
}

/// Who may have a database open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[doc(hidden)]
pub enum Sharing {
    /// One service.
    Alone,
    /// Others as well: what a test has.
    WithOthers,
}

/// The same, with jobs that may be run twice, and beside others.
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
        schema::bring(&servers).await?;
        let records = Session::new(servers.connect(Purpose::Records).await?);
        let mut telemetry = Session::new(servers.connect(Purpose::Telemetry).await?);
        let mut lock = (sharing == Sharing::Alone).then(ExclusiveLock::default);
        if let Some(lock) = &mut lock {
            lock.take(&servers, &mut telemetry).await?;
        }
        telemetry::note_start(&mut telemetry, clock.now()).await?;
        let history = History::open(&mut telemetry).await?;
        let reader = SqlReader::new(servers.read_pool().await?);
        let database = Arc::new(Open {
            servers: Arc::clone(&servers),
            _held: held,
        });
        Ok(Store::start(
            Records::new(Arc::clone(&servers), records, jobs),
            Telemetry::new(servers, telemetry, history, lock),
            reader,
            database,
            clock,
        ))
    })
}

/// Opens the database for administration. The schema must be this program's.
///
/// # Errors
/// [`StoreError::Server`] when no server can be used, [`StoreError::OtherSchema`] when the database
/// has another schema.
pub fn administration(setup: PostgresSetup) -> Boxed<'static, Result<Administration, StoreError>> {
    Box::pin(async move {
        let servers = Arc::new(Servers::new(setup)?);
        let mut records = Session::new(servers.connect(Purpose::Records).await?);
        let (found, known) = (schema::found(&mut records).await?, schema::known());
        if found != Some(known) {
            let found = found.unwrap_or(0);
            return Err(StoreError::OtherSchema { found, known });
        }
        let reader = SqlReader::new(servers.read_pool().await?);
        let writer = Records::new(servers, records, JobRuns::Once);
        Ok(Administration::new(writer, reader, None))
    })
}
