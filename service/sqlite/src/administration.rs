//! The store for a command that administrates, also beside the service that holds the folder.

use std::fs::{File, OpenOptions};
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use async_trait::async_trait;
use fleetcal_folder::Folder;
use fleetcal_sql::{Connection, Dialect, Row, Statement, StatementError};
use fleetcal_store::backend::Reader as _;
use fleetcal_store::{Administration, StoreError};
use sqlx::ConnectOptions as _;
use sqlx::sqlite::SqliteConnection;

use super::connection::OnConnection;
use super::writer::SharedWriter;

/// Opens the database of a folder for administration, whether a service holds it or not. It never
/// creates one: a folder without a database is a wrong folder.
///
/// # Errors
/// [`StoreError::Missing`] without a database, [`StoreError::OtherSchema`] if a service of another
/// version runs on it, or another error of opening it.
pub async fn administration(path: &Path) -> Result<Administration, StoreError> {
    let database = Folder::database_in(path);
    if !database.is_file() {
        return Err(StoreError::Missing { path: database });
    }
    let folder = match Folder::hold(path) {
        Ok(folder) => Some(folder),
        Err(StoreError::InUse { .. }) => None,
        Err(error) => return Err(error),
    };
    let (writer, reader) = super::administer(&database, folder.as_ref()).await?;
    // Held as long as no service runs, so that none starts in the middle of a migration.
    let held = folder.map(|folder| Box::new(folder) as _);
    Ok(Administration::new(SharedWriter::new(writer), reader, held))
}

/// A database to be read as a whole, while no service runs on it.
pub struct Source {
    connection: SqliteConnection,
    _folder: Folder,
}

impl Source {
    /// Locks a folder, opens its database, and migrates it to this program's schema.
    ///
    /// # Errors
    /// [`StoreError::Missing`] without a database, [`StoreError::InUse`] while a service runs on
    /// it, or another error of opening it.
    pub async fn open(path: &Path) -> Result<Self, StoreError> {
        let database = Folder::database_in(path);
        if !database.is_file() {
            return Err(StoreError::Missing { path: database });
        }
        let folder = Folder::hold(path)?;
        let (writer, reader) = super::administer(&database, Some(&folder)).await?;
        reader.close().await;
        writer.close().await?;
        let connection = super::options(&database).read_only(true).connect().await;
        Ok(Self {
            connection: connection.map_err(StoreError::database("be opened for reading"))?,
            _folder: folder,
        })
    }
}

#[async_trait]
impl Connection for Source {
    fn dialect(&self) -> Dialect {
        Dialect::Sqlite
    }

    async fn rows(&mut self, statement: Statement) -> Result<Vec<Row>, StatementError> {
        OnConnection(&mut self.connection).rows(statement).await
    }

    async fn execute(&mut self, statement: Statement) -> Result<u64, StatementError> {
        OnConnection(&mut self.connection).execute(statement).await
    }
}

/// Copies the database of a folder into the file `to`, whole and as of one moment, also while a
/// service writes. Only its owner can read the file, which appears once it is complete and replaces
/// an existing one.
///
/// # Errors
/// [`StoreError::Missing`] without a database, [`StoreError::Backup`] if the file cannot be
/// written.
pub async fn backup(folder: &Path, to: &Path) -> Result<(), StoreError> {
    let database = Folder::database_in(folder);
    if !database.is_file() {
        return Err(StoreError::Missing { path: database });
    }
    let failed = |source: Error| StoreError::Backup {
        path: to.to_owned(),
        source: Arc::new(source),
    };
    let unfinished = unfinished(to).ok_or_else(|| failed(ErrorKind::InvalidFilename.into()))?;
    make_private(&unfinished).map_err(failed)?;
    let copied = super::copy(&database, &unfinished).await;
    let finished = copied.and_then(|()| finish(&unfinished, to).map_err(failed));
    if finished.is_err()
        && let Err(error) = std::fs::remove_file(&unfinished)
    {
        tracing::warn!(%error, "an unfinished backup is left behind");
    }
    finished
}

/// Returns the path of a backup until it is complete.
pub(super) fn unfinished(to: &Path) -> Option<PathBuf> {
    let mut name = to.file_name()?.to_owned();
    name.push(".tmp");
    Some(to.with_file_name(name))
}

/// Creates an empty file that its owner alone can read; one that an earlier backup left is removed.
pub(super) fn make_private(path: &Path) -> Result<(), Error> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options.open(path).map(drop)
}

/// Renames a complete backup durably.
pub(super) fn finish(unfinished: &Path, to: &Path) -> Result<(), Error> {
    File::open(unfinished)?.sync_all()?;
    std::fs::rename(unfinished, to)?;
    let folder = to.parent().filter(|folder| !folder.as_os_str().is_empty());
    File::open(folder.unwrap_or(Path::new(".")))?.sync_all()
}
