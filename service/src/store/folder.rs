//! The folder of the data: made when missing, held by one process at a time.

use std::fs::{DirBuilder, File, OpenOptions, TryLockError};
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::StoreError;

/// Name of the lock file.
const LOCK_FILE: &str = "fleetcal.lock";
/// Name of the database.
const DATABASE_FILE: &str = "fleetcal.db";

/// A folder that is held until this value goes. The lock is the system's, so that a killed
/// process leaves none behind.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    _lock: File,
}

impl Folder {
    /// Makes the folder when it is missing and takes it.
    ///
    /// # Errors
    /// [`StoreError::InUse`] when another process holds it, [`StoreError::Folder`] when it cannot
    /// be made or used.
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

    /// The database in it.
    pub fn database(&self) -> PathBuf {
        Self::database_in(&self.path)
    }

    /// The database of a folder.
    pub fn database_in(path: &Path) -> PathBuf {
        path.join(DATABASE_FILE)
    }

    /// Makes the names of the files in it durable: a new database is not there after a power cut
    /// while its folder is not synced.
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

/// Makes a folder that only its owner can read, if it is not there.
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
    fn a_file_in_its_place_is_named() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("data");
        std::fs::write(&path, b"").unwrap();
        let refused = Folder::hold(&path).unwrap_err();
        assert!(refused.to_string().contains("data"), "{refused}");
    }
}
