//! The service's signing key: made at the first start, kept beside the database, with the changes
//! that led to it in a file beside it.

use std::ffi::OsString;
use std::fs::{File, OpenOptions};
use std::io::{Error, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use fleetcal_model::WallTime;
use fleetcal_proto::calibration::Envelope;
use fleetcal_proto::key_change::{
    KEY_CHANGE_BYTES_MAX, KEY_CHANGES_MAX, KeyChanges, KeyChangesRefused, ServiceKeys,
};
use fleetcal_proto::signing::{KEY_BYTES, PublicKey, SealRefused, SigningKey};
use thiserror::Error;

/// Name of the key's file in the data folder.
pub const KEY_FILE: &str = "signing.key";
/// Suffix of the file of the changes, behind the key's name.
const CHANGES_ENDING: &str = ".changes";
/// Longest file of changes that is read, bytes.
const CHANGES_BYTES_MAX: u64 = (KEY_CHANGE_BYTES_MAX * KEY_CHANGES_MAX) as u64;

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
    /// The file of the changes is not as it was written.
    #[error("changes of the signing key {path}: {reason}")]
    Changes {
        /// The file.
        path: PathBuf,
        /// Fault of the file.
        reason: String,
    },
    /// The change cannot be written.
    #[error(transparent)]
    Seal(#[from] SealRefused),
}

/// Reads the key of a data folder, or makes one from the result of `draw`, bytes of a cryptographic
/// random source, with the changes that led to it; returns whether it was made now. Only its owner
/// can read the file.
///
/// # Errors
/// [`KeyError`].
pub fn load_or_make(
    folder: &Path,
    draw: impl FnOnce() -> Result<[u8; KEY_BYTES], Error>,
) -> Result<(ServiceKeys, bool), KeyError> {
    load_or_make_at(&folder.join(KEY_FILE), draw)
}

/// Reads or makes a key in a file of its own.
///
/// # Errors
/// [`KeyError`].
pub fn load_or_make_at(
    path: &Path,
    draw: impl FnOnce() -> Result<[u8; KEY_BYTES], Error>,
) -> Result<(ServiceKeys, bool), KeyError> {
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
            write(&path, &secret, None).map_err(failed)?;
            bytes.extend(secret);
            made = true;
        }
        Err(error) => return Err(failed(error)),
    }
    let length = bytes.len();
    let secret = <[u8; KEY_BYTES]>::try_from(bytes);
    let secret = secret.map_err(|_| KeyError::Length {
        path: path.clone(),
        length,
    })?;
    let key = SigningKey::from_bytes(&secret);
    let changes = read_changes(&path)?.up_to(&key.public_key());
    Ok((ServiceKeys { key, changes }, made))
}

/// Replaces a key by one made from the result of `draw`, and adds the change, signed with the
/// former key, to the file beside it; returns the new public half. A service uses both from its next
/// start on. A kill in the middle leaves the former key, with a change that does not count.
///
/// # Errors
/// As [`load_or_make_at`]; a key is not made.
pub fn rotate(
    path: &Path,
    draw: impl FnOnce() -> Result<[u8; KEY_BYTES], Error>,
    now: WallTime,
    former_accepted_s: u32,
) -> Result<PublicKey, KeyError> {
    let failed = |source| KeyError::File {
        path: path.to_owned(),
        source,
    };
    let none = || Err(Error::from(ErrorKind::NotFound));
    let (ServiceKeys { key, mut changes }, _) = load_or_make_at(path, none)?;
    let secret = draw().map_err(failed)?;
    let new = SigningKey::from_bytes(&secret).public_key();
    changes.add(&key, &new, now, former_accepted_s)?;
    let mut lines = Vec::new();
    for envelope in changes.envelopes() {
        serde_json::to_writer(&mut lines, &envelope).map_err(SealRefused::from)?;
        lines.push(b'\n');
    }
    // The key last: it ends the former one.
    write(&changes_of(path), &lines, Some(path)).map_err(failed)?;
    write(path, &secret, Some(path)).map_err(failed)?;
    Ok(new)
}

/// Returns the file of the changes that led to the key in a file.
pub fn changes_of(path: &Path) -> PathBuf {
    beside(path, CHANGES_ENDING)
}

fn beside(path: &Path, ending: &str) -> PathBuf {
    let mut name: OsString = path.as_os_str().to_owned();
    name.push(ending);
    PathBuf::from(name)
}

fn read_changes(key: &Path) -> Result<KeyChanges, KeyError> {
    let path = changes_of(key);
    let mut text = String::new();
    let read =
        File::open(&path).and_then(|file| file.take(CHANGES_BYTES_MAX).read_to_string(&mut text));
    match read {
        Ok(_) => {}
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(KeyChanges::default()),
        Err(source) => return Err(KeyError::File { path, source }),
    }
    let lines: Result<Vec<Envelope>, String> = text
        .lines()
        .map(|line| serde_json::from_str(line).map_err(|error| error.to_string()))
        .collect();
    let checked = lines.and_then(|envelopes| {
        KeyChanges::check(envelopes).map_err(|refused: KeyChangesRefused| refused.to_string())
    });
    checked.map_err(|reason| KeyError::Changes { path, reason })
}

/// Writes the file whole or not at all, and durably before anything is signed with it. It belongs to
/// the owner of `like`.
fn write(path: &Path, content: &[u8], like: Option<&Path>) -> Result<(), Error> {
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    let unfinished = beside(path, ".new");
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    let mut file = options.open(&unfinished)?;
    file.write_all(content)?;
    if let Some(like) = like {
        give(&file, like)?;
    }
    file.sync_all()?;
    std::fs::rename(&unfinished, path)?;
    File::open(folder)?.sync_all()
}

/// Gives a file to the owner of another one: an administrator may write for the service.
#[cfg(unix)]
fn give(file: &File, like: &Path) -> Result<(), Error> {
    use std::os::unix::fs::MetadataExt as _;
    let owner = std::fs::metadata(like)?;
    let present = file.metadata()?;
    if (present.uid(), present.gid()) == (owner.uid(), owner.gid()) {
        return Ok(());
    }
    std::os::unix::fs::fchown(file, Some(owner.uid()), Some(owner.gid()))
}

#[cfg(not(unix))]
fn give(_file: &File, _like: &Path) -> Result<(), Error> {
    Ok(())
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
        assert_eq!(made.key.public_key(), read.key.public_key());
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

    fn of(number: u8) -> impl FnOnce() -> Result<[u8; KEY_BYTES], Error> {
        move || Ok([number; KEY_BYTES])
    }

    fn public(number: u8) -> PublicKey {
        SigningKey::from_bytes(&[number; KEY_BYTES]).public_key()
    }

    const DAY_NS: i64 = 86_400_000_000_000;

    #[test]
    fn a_key_is_replaced_with_its_change_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(KEY_FILE);
        let day = |number: i64| WallTime(number * DAY_NS);
        let missing = rotate(&path, of(8), day(0), 86_400).unwrap_err();
        assert!(matches!(missing, KeyError::File { .. }), "{missing}");
        load_or_make_at(&path, sevens).unwrap();
        assert_eq!(rotate(&path, of(8), day(0), 86_400).unwrap(), public(8));
        // While the former key is accepted.
        rotate(&path, of(9), day(0), 86_400).unwrap();
        let (keys, made) = load_or_make_at(&path, of(1)).unwrap();
        assert!(!made);
        assert_eq!(keys.key.public_key(), public(9));
        assert_eq!(keys.changes.former_keys(), [public(7), public(8)]);
        #[cfg(unix)]
        for file in [&path, &changes_of(&path)] {
            use std::os::unix::fs::PermissionsExt;
            let mode = std::fs::metadata(file).unwrap().permissions().mode();
            assert_eq!(mode & 0o777, 0o600);
        }
    }

    #[test]
    fn a_rotation_that_was_killed_leaves_the_former_key_and_can_be_repeated() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(KEY_FILE);
        load_or_make_at(&path, sevens).unwrap();
        let day = |number: i64| WallTime(number * DAY_NS);
        rotate(&path, of(8), day(0), 60).unwrap();
        // Killed between the two files.
        std::fs::write(&path, [7; KEY_BYTES]).unwrap();
        let (keys, _) = load_or_make_at(&path, of(1)).unwrap();
        assert_eq!(keys.changes, KeyChanges::default());
        rotate(&path, of(9), day(0), 60).unwrap();
        let (keys, _) = load_or_make_at(&path, of(1)).unwrap();
        assert_eq!(keys.key.public_key(), public(9));
        assert_eq!(keys.changes.former_keys(), [public(7)]);
    }

    #[test]
    fn a_file_of_changes_that_was_altered_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(KEY_FILE);
        load_or_make_at(&path, sevens).unwrap();
        rotate(&path, of(8), WallTime(0), 60).unwrap();
        let changes = changes_of(&path);
        let text = std::fs::read_to_string(&changes).unwrap();
        for altered in [text.replace("key_change/1", "key_change/2"), "x".to_owned()] {
            std::fs::write(&changes, altered).unwrap();
            let refused = load_or_make_at(&path, sevens).unwrap_err().to_string();
            assert!(refused.contains("signing.key.changes"), "{refused}");
        }
    }
}
