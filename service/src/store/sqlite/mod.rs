//! The store's database in SQLite: one connection that writes, a pool that only reads.

mod accounts;
mod alerts;
mod approvals;
mod audit;
mod columns;
mod events;
mod policy;
mod read;
mod records;
mod robots;
mod webhooks;
mod write;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use sqlx::migrate::{MigrateError, Migrator};
use sqlx::sqlite::{
    SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous,
};
use sqlx::{ConnectOptions, Connection};

use super::Outlives;
use super::backend::Reader as _;
use super::error::StoreError;
use super::folder::Folder;
use super::record::{EventKind, EventSource};
use crate::limits;

pub(super) use read::SqliteReader;
pub(super) use write::SqliteWriter;

static MIGRATIONS: Migrator = sqlx::migrate!("../migrations/sqlite");

/// The newest migration in this program.
pub(super) fn schema_known() -> i64 {
    MIGRATIONS
        .iter()
        .map(|migration| migration.version)
        .max()
        .unwrap_or(0)
}

/// Opens the database of a folder, makes it when it is missing, and brings it to this program's
/// schema.
///
/// # Errors
/// [`StoreError::NewerSchema`], [`StoreError::Migration`], [`StoreError::Database`] or
/// [`StoreError::Folder`].
pub(super) async fn open(
    folder: &Folder,
    now_ns: i64,
    outlives: Outlives,
) -> Result<(SqliteWriter, SqliteReader), StoreError> {
    let path = folder.database();
    let synchronous = match outlives {
        Outlives::Power => SqliteSynchronous::Full,
        Outlives::Process => SqliteSynchronous::Normal,
    };
    let mut connection = options(&path)
        .synchronous(synchronous)
        .create_if_missing(true)
        .connect()
        .await
        .map_err(StoreError::database("be opened"))?;
    migrate(&mut connection, path.clone()).await?;
    // Before anything is acknowledged, the new file must also be in its folder for good.
    folder.sync()?;
    note_start(&mut connection, now_ns).await?;
    let reader = readers(&path).await?;
    Ok((SqliteWriter::new(connection), reader))
}

/// Opens the database of a folder for administration. A folder that is held is migrated, and made
/// when it is missing; that of a running service is taken as it is.
///
/// # Errors
/// [`StoreError::OtherSchema`] when the running service is another version; else those of
/// [`open`].
pub(super) async fn administer(
    path: &Path,
    held: Option<&Folder>,
) -> Result<(SqliteWriter, SqliteReader), StoreError> {
    let mut connection = options(path)
        .create_if_missing(held.is_some())
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
    Ok((SqliteWriter::new(connection), reader))
}

/// Copies a database as it is now into `to`, which is empty or missing.
///
/// # Errors
/// [`StoreError::Database`].
pub(super) async fn copy(path: &Path, to: &Path) -> Result<(), StoreError> {
    let failed = || StoreError::database("be copied");
    let mut connection = options(path)
        .read_only(true)
        .connect()
        .await
        .map_err(StoreError::database("be opened for reading"))?;
    sqlx::query("VACUUM INTO ?1")
        .bind(to.to_string_lossy().into_owned())
        .execute(&mut connection)
        .await
        .map_err(failed())?;
    close(connection).await
}

async fn readers(path: &Path) -> Result<SqliteReader, StoreError> {
    let pool = SqlitePoolOptions::new()
        .max_connections(limits::STORE_READERS_MAX)
        .acquire_timeout(limits::STORE_READ_TIMEOUT)
        .connect_with(options(path).read_only(true))
        .await
        .map_err(StoreError::database("be opened for reading"))?;
    Ok(SqliteReader::new(pool))
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

/// Puts the service's start into the history of every robot whose estimator goes on from here.
async fn note_start(connection: &mut SqliteConnection, now_ns: i64) -> Result<(), StoreError> {
    sqlx::query(
        "INSERT INTO robot_event (robot, kind, stamp_ns, received_ns, source)
         SELECT robot, ?1, stamp_ns, ?2, ?3 FROM checkpoint",
    )
    .bind(EventKind::ServiceStarted.as_str())
    .bind(now_ns)
    .bind(EventSource::Service.as_str())
    .execute(connection)
    .await
    .map_err(StoreError::database("note the service's start"))?;
    Ok(())
}

/// Closes a connection, which also folds the write-ahead log into the database.
async fn close(connection: SqliteConnection) -> Result<(), StoreError> {
    connection
        .close()
        .await
        .map_err(StoreError::database("be closed"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_connection_is_durable_and_keeps_references() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("fleetcal.db");
        let mut connection = options(&path)
            .create_if_missing(true)
            .connect()
            .await
            .unwrap();
        let mut pragma = async |sql: &'static str| -> String {
            sqlx::query_scalar::<_, String>(sql)
                .fetch_one(&mut connection)
                .await
                .unwrap()
        };
        assert_eq!(
            pragma("SELECT journal_mode FROM pragma_journal_mode").await,
            "wal"
        );
        let numbers = "SELECT s.synchronous || ' ' || f.foreign_keys || ' ' || b.timeout
             FROM pragma_synchronous AS s, pragma_foreign_keys AS f, pragma_busy_timeout AS b";
        // 2 is FULL.
        assert_eq!(pragma(numbers).await, "2 1 5000");
    }
}
