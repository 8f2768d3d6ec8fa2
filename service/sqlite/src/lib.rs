//! The store's database in SQLite: one connection that writes, a pool that only reads.

mod administration;
mod connection;
mod place;
mod restore;
mod testing;
#[cfg(test)]
mod tests;
mod writer;

use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::Arc;

use fleetcal_clock::SharedClock;
use fleetcal_domain::limits;
use fleetcal_model::WallTime;
use fleetcal_sql::{SqlReader, telemetry};
use fleetcal_store::backend::{Database, Reader as _};
use fleetcal_store::{Store, StoreError};
use sqlx::migrate::{MigrateError, Migrator};
use sqlx::sqlite::{
    SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous,
};
use sqlx::{ConnectOptions, Connection};

use connection::{OnConnection, ReadPool};
use fleetcal_folder::Folder;
use writer::{JobRuns, SharedWriter, SqliteWriter};

pub use administration::{Source, administration, backup};
pub use restore::{Restored, restore};
#[doc(hidden)]
pub use testing::execute_for_test;

static MIGRATIONS: Migrator = sqlx::migrate!("../../migrations/sqlite");

/// Future that is compiled in this crate instead of each that awaits it.
pub type Boxed<'a, T> = Pin<Box<dyn Future<Output = T> + Send + 'a>>;

/// Failure that an acknowledged commit survives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outlives {
    /// Loss of the machine's power. The service uses nothing else.
    Power,
    /// End of the process alone. With this, the test that cuts the power shows that it can fail.
    #[doc(hidden)]
    Process,
}

/// The database of a folder, which is locked as long as this value exists.
#[derive(Debug)]
struct Held {
    folder: Folder,
}

impl Database for Held {
    fn schema_known(&self) -> i64 {
        schema_known()
    }

    fn write_once(&self) -> Boxed<'static, Result<(), StoreError>> {
        Box::pin(write_once(self.folder.database()))
    }
}

/// Opens the store of a folder, which is created if missing, and starts its writer.
///
/// # Errors
/// [`StoreError::InUse`] if another process has it, [`StoreError::NewerSchema`] if a newer program
/// wrote it, or another error of opening it.
pub fn open(folder: &Path, clock: SharedClock) -> Boxed<'_, Result<Store, StoreError>> {
    open_with(folder, clock, Outlives::Power)
}

/// Opens the store with commits of weaker durability.
///
/// # Errors
/// As [`open`].
#[doc(hidden)]
pub fn open_with(
    folder: &Path,
    clock: SharedClock,
    outlives: Outlives,
) -> Boxed<'_, Result<Store, StoreError>> {
    Box::pin(start(folder, clock, outlives, JobRuns::Once))
}

/// Opens the store so that each job runs twice, with the first run undone: this lets tests find a
/// job that cannot be repeated.
///
/// # Errors
/// As [`open`].
#[doc(hidden)]
pub fn open_running_twice(
    folder: &Path,
    clock: SharedClock,
) -> Boxed<'_, Result<Store, StoreError>> {
    Box::pin(start(folder, clock, Outlives::Process, JobRuns::Twice))
}

async fn start(
    folder: &Path,
    clock: SharedClock,
    outlives: Outlives,
    jobs: JobRuns,
) -> Result<Store, StoreError> {
    let folder = Folder::hold(folder)?;
    let (writer, reader) = connect(&folder, clock.now(), outlives, jobs).await?;
    let records = SharedWriter::new(writer);
    let telemetry = records.clone();
    let held = Arc::new(Held { folder });
    Ok(Store::start(records, telemetry, reader, held, clock))
}

/// Returns the newest migration in this program.
fn schema_known() -> i64 {
    MIGRATIONS
        .iter()
        .map(|migration| migration.version)
        .max()
        .unwrap_or(0)
}

/// Opens the database of a folder, creates it if missing, and migrates it to this program's schema.
///
/// # Errors
/// [`StoreError::NewerSchema`], [`StoreError::Migration`], [`StoreError::Database`] or
/// [`StoreError::Folder`].
async fn connect(
    folder: &Folder,
    now: WallTime,
    outlives: Outlives,
    jobs: JobRuns,
) -> Result<(SqliteWriter, SqlReader), StoreError> {
    folder.check_whole()?;
    folder.make_private()?;
    let path = folder.database();
    let synchronous = match outlives {
        Outlives::Power => SqliteSynchronous::Full,
        Outlives::Process => SqliteSynchronous::Normal,
    };
    let options = options(&path).synchronous(synchronous);
    let mut connection = options
        .clone()
        .create_if_missing(true)
        .connect()
        .await
        .map_err(StoreError::database("be opened"))?;
    migrate(&mut connection, path.clone()).await?;
    // Before anything is acknowledged, the new file must also be in its folder for good.
    folder.sync()?;
    telemetry::note_start(&mut OnConnection(&mut connection), now).await?;
    let reader = readers(&path).await?;
    let writer = SqliteWriter::new(connection, options, jobs, &path).await?;
    Ok((writer, reader))
}

/// Opens the database of a folder for administration. A locked folder is migrated; that of a
/// running service is used unchanged.
///
/// # Errors
/// [`StoreError::OtherSchema`] if the running service has another version; else those of [`open`].
async fn administer(
    path: &Path,
    held: Option<&Folder>,
) -> Result<(SqliteWriter, SqlReader), StoreError> {
    if let Some(folder) = held {
        folder.check_whole()?;
        folder.make_private()?;
    }
    let options = options(path);
    let mut connection = options
        .connect()
        .await
        .map_err(StoreError::database("be opened"))?;
    if let Some(folder) = held {
        migrate(&mut connection, path.to_owned()).await?;
        folder.sync()?;
    }
    let reader = readers(path).await?;
    let (found, known) = (reader.schema_version().await?, schema_known());
    if found != known {
        return Err(StoreError::OtherSchema { found, known });
    }
    Ok((
        SqliteWriter::new(connection, options, JobRuns::Once, path).await?,
        reader,
    ))
}

/// Copies the present database into `to`, which is empty or missing.
///
/// # Errors
/// [`StoreError::Database`].
async fn copy(path: &Path, to: &Path) -> Result<(), StoreError> {
    let mut connection = options(path)
        .read_only(true)
        .connect()
        .await
        .map_err(StoreError::database("be opened for reading"))?;
    copy_into(&mut connection, to).await?;
    close(connection).await
}

async fn copy_into(connection: &mut SqliteConnection, to: &Path) -> Result<(), StoreError> {
    sqlx::query("VACUUM INTO $1")
        .bind(to.to_string_lossy().into_owned())
        .execute(connection)
        .await
        .map_err(StoreError::database("be copied"))?;
    Ok(())
}

/// Writes over a connection of its own, to test whether the database accepts writes at all.
///
/// # Errors
/// [`StoreError::Database`].
async fn write_once(path: PathBuf) -> Result<(), StoreError> {
    let mut connection = options(&path)
        .connect()
        .await
        .map_err(StoreError::database("be opened"))?;
    sqlx::query("UPDATE probe SET written_ns = written_ns")
        .execute(&mut connection)
        .await
        .map_err(StoreError::database("write at all"))?;
    close(connection).await
}

async fn readers(path: &Path) -> Result<SqlReader, StoreError> {
    let pool = SqlitePoolOptions::new()
        .max_connections(limits::STORE_READERS_MAX)
        .acquire_timeout(limits::STORE_READ_TIMEOUT)
        .connect_with(options(path).read_only(true))
        .await
        .map_err(StoreError::database("be opened for reading"))?;
    Ok(SqlReader::new(ReadPool(pool)))
}

fn options(path: &Path) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(path)
        .journal_mode(SqliteJournalMode::Wal)
        // A commit that was acknowledged outlives the machine's power, not the process alone.
        .synchronous(SqliteSynchronous::Full)
        .busy_timeout(limits::STORE_BUSY_TIMEOUT)
        .foreign_keys(true)
}

async fn migrate(connection: &mut SqliteConnection, path: PathBuf) -> Result<(), StoreError> {
    match MIGRATIONS.run_direct(None, connection, false).await {
        Ok(()) => Ok(()),
        Err(MigrateError::VersionMissing(found)) => Err(StoreError::NewerSchema {
            path,
            found,
            known: schema_known(),
        }),
        Err(error) => Err(StoreError::Migration(Arc::new(error))),
    }
}

/// Closes a connection, which also folds the write-ahead log into the database.
async fn close(connection: SqliteConnection) -> Result<(), StoreError> {
    connection
        .close()
        .await
        .map_err(StoreError::database("be closed"))
}
