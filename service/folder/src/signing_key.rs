//! The service's signing key: made at the first start, kept beside the database.

use std::fs::{File, OpenOptions};
use std::io::{Error, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use fleetcal_proto::signing::{KEY_BYTES, SigningKey};
use thiserror::Error;

/// Name of the key's file in the data folder.
pub const KEY_FILE: &str = "signing.key";

/// Reason for which there is no signing key.
#[derive(Debug, Error)]
pub enum KeyError {
    /// Its file cannot be read or written.
    #[error("the signing key {path} cannot be read or written: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: Error,
    },
    /// Its file has the wrong length.
    #[error("signing key {path}: got {length} bytes, expected 32")]
    Length {
        /// The file.
        path: PathBuf,
        /// Length of the file, bytes.
        length: usize,
    },
}

/// Reads the key of a data folder, or makes one from the result of `draw`, bytes of a cryptographic
/// random source; returns whether it was made now. Only its owner can read the file.
///
/// # Errors
/// [`KeyError`].
pub fn load_or_make(
    folder: &Path,
    draw: impl FnOnce() -> Result<[u8; KEY_BYTES], Error>,
) -> Result<(SigningKey, bool), KeyError> {
    load_or_make_at(&folder.join(KEY_FILE), draw)
}

/// Reads or makes a key in a file of its own.
///
/// # Errors
/// [`KeyError`].
pub fn load_or_make_at(
    path: &Path,
    draw: impl FnOnce() -> Result<[u8; KEY_BYTES], Error>,
) -> Result<(SigningKey, bool), KeyError> {
    let path = path.to_owned();
    let failed = |source| KeyError::File {
        path: path.clone(),
        source,
    };
    let mut bytes = Vec::new();
    let mut made = false;
    match File::open(&path) {
        Ok(file) => {
            // One byte more than a key has tells that the file is longer.
            file.take(KEY_BYTES as u64 + 1)
                .read_to_end(&mut bytes)
                .map_err(failed)?;
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let secret = draw().map_err(failed)?;
            write(&path, &secret).map_err(failed)?;
            bytes.extend(secret);
            made = true;
        }
        Err(error) => return Err(failed(error)),
    }
    let length = bytes.len();
    let secret = <[u8; KEY_BYTES]>::try_from(bytes);
    let secret = secret.map_err(|_| KeyError::Length { path, length })?;
    Ok((SigningKey::from_bytes(&secret), made))
}

/// Writes the file whole or not at all, and durably before anything is signed with it.
fn write(path: &Path, secret: &[u8]) -> Result<(), Error> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let unfinished = path.with_extension("new");
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    let mut file = options.open(&unfinished)?;
    file.write_all(secret)?;
    file.sync_all()?;
    std::fs::rename(&unfinished, path)?;
    File::open(folder)?.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[expect(clippy::unnecessary_wraps, reason = "takes the place of what can fail")]
    fn sevens() -> Result<[u8; KEY_BYTES], Error> {
        Ok([7; KEY_BYTES])
    }

    #[test]
    fn a_key_is_made_once_and_stays() {
        let folder = tempfile::tempdir().unwrap();
        let (made, is_new) = load_or_make(folder.path(), sevens).unwrap();
        assert!(is_new);
        let never = || panic!("there is one");
        let (read, is_new) = load_or_make(folder.path(), never).unwrap();
        assert!(!is_new);
        assert_eq!(made.public_key(), read.public_key());
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let metadata = std::fs::metadata(folder.path().join(KEY_FILE)).unwrap();
            assert_eq!(metadata.permissions().mode() & 0o777, 0o600);
        }
    }

    #[test]
    fn a_file_that_is_no_key_is_named() {
        let folder = tempfile::tempdir().unwrap();
        for length in [0, 31, 33, 4096] {
            std::fs::write(folder.path().join(KEY_FILE), vec![1; length]).unwrap();
            let refused = load_or_make(folder.path(), sevens).unwrap_err().to_string();
            assert!(refused.contains("signing.key"), "{refused}");
        }
    }
}
