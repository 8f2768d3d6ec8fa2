//! The place of an open database: a file that is moved away is still written, for nobody.

use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fleetcal_store::StoreError;

/// Number of a file on its device, with the device.
type Identity = (u64, u64);

/// Files of an open database, as they were when it was opened.
#[derive(Debug)]
pub(crate) struct Place(Vec<(PathBuf, Identity)>);

impl Place {
    /// Remembers the database and its log.
    pub(crate) fn of(database: &Path) -> Self {
        let mut log = database.as_os_str().to_owned();
        log.push("-wal");
        let files = [database.to_owned(), PathBuf::from(log)];
        let known = |path: PathBuf| identity(&path).map(|identity| (path, identity));
        Self(files.into_iter().filter_map(known).collect())
    }

    /// Checks that the files are where they were opened.
    ///
    /// # Errors
    /// [`StoreError::Folder`] with the first that was moved, removed or replaced.
    pub(crate) fn check(&self) -> Result<(), StoreError> {
        let moved = |(path, known): &&(PathBuf, Identity)| identity(path) != Some(*known);
        let Some((path, _)) = self.0.iter().find(moved) else {
            return Ok(());
        };
        let reason = "was moved, removed or replaced while the service has it open: whatever is \
                      written now is lost. Restart the service, and stop it before files are put \
                      in their places";
        Err(StoreError::Folder {
            path: path.clone(),
            source: Arc::new(Error::new(ErrorKind::NotFound, reason)),
        })
    }
}

#[cfg(unix)]
fn identity(path: &Path) -> Option<Identity> {
    use std::os::unix::fs::MetadataExt as _;
    let file = std::fs::metadata(path).ok()?;
    Some((file.dev(), file.ino()))
}

/// Without numbers of files only a missing one shows.
#[cfg(not(unix))]
fn identity(path: &Path) -> Option<Identity> {
    path.exists().then_some((0, 0))
}
