//! A backup becomes the database of a folder that has none.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fleetcal_folder::Folder;
use fleetcal_folder::signing_key::{KEY_FILE, changes_of};
use fleetcal_proto::signing::KEY_BYTES;
use fleetcal_store::StoreError;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions as _, SqliteConnection};

use super::administration::{finish, make_private, unfinished};
use super::{close, copy_into, schema_known};

/// Result of a restore.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Restored {
    /// Number of robots in the database.
    pub robots: u64,
    /// True if the signing key is there, without which agents refuse the service's documents.
    pub has_key: bool,
}

/// Puts a backup, and the signing key of its folder, into `folder`, which must have neither a
/// database nor another key. The backup is checked first. On failure, neither remains; a kill in
/// the middle may leave the key, with which it can be run again.
///
/// # Errors
/// [`StoreError::Restore`] for an unusable backup or key or a folder that has a database,
/// [`StoreError::NewerSchema`] for a backup of a newer program, [`StoreError::InUse`] while a
/// service runs on the folder, [`StoreError::Folder`] if it cannot be written.
pub async fn restore(
    backup: &Path,
    key: Option<&Path>,
    folder: &Path,
) -> Result<Restored, StoreError> {
    let robots = check(backup).await?;
    let secret = key.map(read_key).transpose()?;
    let held = Folder::hold(folder)?;
    let database = held.database();
    if std::fs::metadata(&database).is_ok_and(|file| file.len() > 0) {
        return Err(refused(
            &database,
            "is a database already; give an empty folder by --data",
        ));
    }
    let key_file = folder.join(KEY_FILE);
    let secret = secret.filter(|secret| std::fs::read(&key_file).ok().as_deref() != Some(secret));
    if secret.is_some() && key_file.exists() {
        return Err(refused(
            &key_file,
            "is another key; leave --signing-key out to keep it",
        ));
    }
    let changes = key.map(|key| read_changes(key, &key_file)).transpose()?;
    let new = unfinished(&database).ok_or_else(|| refused(&database, "cannot be named"))?;
    let key = Key {
        secret,
        changes: changes.flatten(),
        file: key_file.clone(),
    };
    let placed = place(backup, &new, &key, &database).await;
    if placed.is_err() && !database.exists() {
        remove(&new);
        if key.secret.is_some() {
            remove(&key.file);
        }
        if key.changes.is_some() {
            remove(&changes_of(&key.file));
        }
    }
    placed?;
    Ok(Restored {
        robots,
        has_key: key_file.exists(),
    })
}

/// Key that is put into the folder; without a secret, the folder's own stays.
struct Key {
    secret: Option<[u8; KEY_BYTES]>,
    /// Content of the file with the changes that led to it.
    changes: Option<Vec<u8>>,
    file: PathBuf,
}

/// Copies the backup beside its place, writes the key, and gives the database its name.
async fn place(backup: &Path, new: &Path, key: &Key, database: &Path) -> Result<(), StoreError> {
    let failed = |source| StoreError::Folder {
        path: database.parent().unwrap_or(database).to_owned(),
        source: Arc::new(source),
    };
    make_private(new).map_err(failed)?;
    let connection = reading(backup).connect().await;
    let mut connection = connection.map_err(StoreError::database("be opened for reading"))?;
    let copied = copy_into(&mut connection, new).await;
    close(connection).await?;
    copied?;
    // The key last: without it nothing of the folder is signed.
    if let Some(changes) = &key.changes {
        write_private(&changes_of(&key.file), changes).map_err(failed)?;
    }
    if let Some(secret) = &key.secret {
        write_private(&key.file, secret).map_err(failed)?;
    }
    finish(new, database).map_err(failed)
}

fn remove(path: &Path) {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            tracing::warn!(path = %path.display(), %error, "an unfinished restoration is left behind");
        }
        _ => {}
    }
}

/// Returns the options for reading a backup, a file that no process writes, and beside which
/// nothing may be written.
fn reading(backup: &Path) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(backup)
        .read_only(true)
        .immutable(true)
}

fn refused(path: &Path, reason: &str) -> StoreError {
    StoreError::Restore {
        path: path.to_owned(),
        reason: reason.to_owned(),
    }
}

/// Checks that a file is a sound database of a schema that this program knows; returns the number
/// of its robots.
async fn check(backup: &Path) -> Result<u64, StoreError> {
    if !backup.is_file() {
        return Err(refused(backup, "is not a file"));
    }
    let unusable =
        |error: sqlx::Error| refused(backup, &format!("is not a usable backup: {error}"));
    let mut connection = reading(backup).connect().await.map_err(unusable)?;
    let checked = sound(&mut connection).await.map_err(unusable);
    close(connection).await?;
    match checked? {
        (found, ..) if found != "ok" => Err(refused(backup, &format!("is damaged: {found}"))),
        (_, found, _) if found > schema_known() => Err(StoreError::NewerSchema {
            path: backup.to_owned(),
            found,
            known: schema_known(),
        }),
        (.., robots) => Ok(robots.unsigned_abs()),
    }
}

/// Returns the result of SQLite's check, the newest migration, and the number of robots.
async fn sound(connection: &mut SqliteConnection) -> Result<(String, i64, i64), sqlx::Error> {
    let said = sqlx::query_scalar("PRAGMA integrity_check(1)")
        .fetch_one(&mut *connection)
        .await?;
    let schema = sqlx::query_scalar("SELECT max(version) FROM _sqlx_migrations")
        .fetch_one(&mut *connection)
        .await?;
    let robots = sqlx::query_scalar("SELECT count(*) FROM robot")
        .fetch_one(connection)
        .await?;
    Ok((said, schema, robots))
}

fn read_key(path: &Path) -> Result<[u8; KEY_BYTES], StoreError> {
    let bytes =
        std::fs::read(path).map_err(|error| refused(path, &format!("cannot be read: {error}")))?;
    let length = bytes.len();
    bytes.try_into().map_err(|_| {
        refused(
            path,
            &format!("is {length} bytes long, expected a signing key of {KEY_BYTES}"),
        )
    })
}

/// Reads the changes that led to a key; `None` where there are none, or the folder has them.
fn read_changes(key: &Path, key_file: &Path) -> Result<Option<Vec<u8>>, StoreError> {
    let (from, to) = (changes_of(key), changes_of(key_file));
    match std::fs::read(&from) {
        Ok(changes) => Ok((std::fs::read(to).ok().as_ref() != Some(&changes)).then_some(changes)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(refused(&from, &format!("cannot be read: {error}"))),
    }
}

fn write_private(path: &Path, content: &[u8]) -> Result<(), std::io::Error> {
    let mut new = OpenOptions::new();
    new.write(true).create(true).truncate(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut new, 0o600);
    let mut file: File = new.open(path)?;
    file.write_all(content)?;
    file.sync_all()
}
