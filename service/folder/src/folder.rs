//! The folder of the data: made when missing, held by one process at a time.

use std::fs::{DirBuilder, File, OpenOptions, Permissions, TryLockError};
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fleetcal_store::StoreError;

use crate::signing_key::KEY_FILE;

/// Name of the lock file.
const LOCK_FILE: &str = "fleetcal.lock";
/// Name of the database.
const DATABASE_FILE: &str = "fleetcal.db";
/// Suffix of SQLite's write-ahead log, behind the database's name.
const LOG_ENDING: &str = "-wal";
const INDEX_ENDING: &str = "-shm";

/// Mode of files that only their owner can read and write.
const PRIVATE: u32 = 0o600;

/// A folder that is locked as long as this value exists. The system holds the lock, so that a
/// killed process leaves none behind.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    _lock: File,
}

impl Folder {
    /// Creates the folder if missing, and locks it.
    ///
    /// # Errors
    /// [`StoreError::InUse`] if another process holds it, [`StoreError::Folder`] if it cannot be
    /// created or used.
    pub fn hold(path: &Path) -> Result<Self, StoreError> {
        let failed = |source: Error| StoreError::Folder {
            path: path.to_owned(),
            source: Arc::new(source),
        };
        make(path).map_err(failed)?;
        let lock_path = path.join(LOCK_FILE);
        let lock = OpenOptions::new()
            .write(true)
            .create(true)
            .truncate(false)
            .open(lock_path)
            .map_err(failed)?;
        match lock.try_lock() {
            Ok(()) => Ok(Self {
                path: path.to_owned(),
                _lock: lock,
            }),
            Err(TryLockError::WouldBlock) => Err(StoreError::InUse {
                path: path.to_owned(),
            }),
            Err(TryLockError::Error(source)) => Err(failed(source)),
        }
    }

    /// Returns the path of the database in it.
    pub fn database(&self) -> PathBuf {
        Self::database_in(&self.path)
    }

    /// Returns the path of the database of a folder.
    pub fn database_in(path: &Path) -> PathBuf {
        path.join(DATABASE_FILE)
    }

    /// Refuses a folder that has lost a part of its content: a new database beside an old signing
    /// key, or an old database without its log, would pass for the whole.
    ///
    /// # Errors
    /// [`StoreError::Gone`].
    pub fn check_whole(&self) -> Result<(), StoreError> {
        let database = self.database();
        let [log, index] = [LOG_ENDING, INDEX_ENDING].map(|ending| beside(&database, ending));
        let gone = |file: &Path, left: &Path, remedy| {
            Err(StoreError::Gone {
                file: file.to_owned(),
                left: left.to_owned(),
                remedy,
            })
        };
        let has_database = std::fs::metadata(&database).is_ok_and(|file| file.len() > 0);
        if !has_database {
            let key = self.path.join(KEY_FILE);
            for left in [&key, &log] {
                if left.exists() {
                    let remedy = "put the database back, from a backup if need be, or move that \
                                  file away to begin with an empty one";
                    return gone(&database, left, remedy);
                }
            }
        } else if index.exists() && !log.exists() {
            // SQLite removes both when it closes the database; a killed process leaves both.
            let remedy = "put it back: it holds the latest writes. To go on without them, for \
                          instance with a backup, remove that file";
            return gone(&log, &index, remedy);
        }
        Ok(())
    }

    /// Restricts the database to its owner, and creates an empty file for it if missing: SQLite
    /// gives the log and its index the same mode.
    ///
    /// # Errors
    /// [`StoreError::Folder`].
    #[cfg(unix)]
    pub fn make_private(&self) -> Result<(), StoreError> {
        use std::os::unix::fs::{OpenOptionsExt as _, PermissionsExt as _};
        let failed = |source: Error| StoreError::Folder {
            path: self.path.clone(),
            source: Arc::new(source),
        };
        let database = self.database();
        let mut options = OpenOptions::new();
        options.append(true).create(true).mode(PRIVATE);
        options.open(&database).map_err(failed)?;
        let [log, index] = [LOG_ENDING, INDEX_ENDING].map(|ending| beside(&database, ending));
        for path in [database, log, index] {
            let mode = match std::fs::metadata(&path) {
                Ok(file) => file.permissions().mode() & 0o777,
                Err(error) if error.kind() == ErrorKind::NotFound => continue,
                Err(error) => return Err(failed(error)),
            };
            if mode != PRIVATE {
                let private = Permissions::from_mode(PRIVATE);
                match std::fs::set_permissions(&path, private) {
                    Ok(()) => {
                        tracing::info!(path = %path.display(), "only its owner can read it now");
                    }
                    // Another user's file that this one may write: it works, and is not private.
                    Err(error) => {
                        tracing::warn!(path = %path.display(), %error, "others can read the database");
                    }
                }
            }
        }
        Ok(())
    }

    /// Makes the names of the files in it durable: a new database is lost in a power cut while its
    /// folder is not synced.
    ///
    /// # Errors
    /// [`StoreError::Folder`].
    pub fn sync(&self) -> Result<(), StoreError> {
        let failed = |source: Error| StoreError::Folder {
            path: self.path.clone(),
            source: Arc::new(source),
        };
        File::open(&self.path)
            .and_then(|folder| folder.sync_all())
            .map_err(failed)
    }
}

/// Returns the file with this suffix behind a database's name.
fn beside(database: &Path, ending: &str) -> PathBuf {
    let mut name = database.as_os_str().to_owned();
    name.push(ending);
    PathBuf::from(name)
}

/// Creates a folder that only its owner can read, unless it exists.
fn make(path: &Path) -> Result<(), Error> {
    if path.is_dir() {
        return Ok(());
    }
    let mut builder = DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    match builder.create(path) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => Err(Error::new(
            ErrorKind::NotADirectory,
            "a file of this name is in its place",
        )),
        result => result,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_holder_is_told_so() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("a/b");
        let held = Folder::hold(&path).unwrap();
        let refused = Folder::hold(&path).unwrap_err();
        assert!(matches!(refused, StoreError::InUse { .. }), "{refused}");
        drop(held);
        Folder::hold(&path).unwrap().sync().unwrap();
    }

    #[test]
    fn a_folder_that_lost_a_part_is_refused() {
        let place = tempfile::tempdir().unwrap();
        let folder = Folder::hold(place.path()).unwrap();
        let make = |name: &str| std::fs::write(place.path().join(name), b"x").unwrap();
        let remove = |name: &str| std::fs::remove_file(place.path().join(name)).unwrap();
        let refused = || folder.check_whole().unwrap_err().to_string();
        folder.check_whole().unwrap();
        for left in ["signing.key", "fleetcal.db-wal"] {
            make(left);
            let sentence = refused();
            assert!(sentence.contains("fleetcal.db is gone"), "{sentence}");
            assert!(sentence.contains(left), "{sentence}");
            remove(left);
        }
        make("fleetcal.db");
        make("signing.key");
        folder.check_whole().unwrap();
        make("fleetcal.db-shm");
        assert!(
            refused().contains("fleetcal.db-wal is gone"),
            "{}",
            refused()
        );
        make("fleetcal.db-wal");
        folder.check_whole().unwrap();
    }

    #[test]
    fn a_file_in_its_place_is_named() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("data");
        std::fs::write(&path, b"").unwrap();
        let refused = Folder::hold(&path).unwrap_err();
        assert!(refused.to_string().contains("data"), "{refused}");
    }
}
