//! Which file holds a recording's messages, and of what kind it is.
//!
//! `rosbag2` writes a folder with one file of messages in it, as MCAP or as an SQLite database
//! (`.db3`), either of which may be packed as a whole with zstd.

use std::fs::File;
use std::io::{BufReader, Read, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use tempfile::{NamedTempFile, TempPath};

use super::{RecordingError, UNPACKED_BYTES_MAX};

/// What a file packed with zstd begins with, and a message that was packed by itself.
pub(super) const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
/// What an SQLite database begins with.
const SQLITE_MAGIC: &[u8] = b"SQLite format 3\0";
/// Endings of the files that hold messages.
const ENDINGS: [&str; 4] = [".mcap", ".db3", ".mcap.zstd", ".db3.zstd"];

/// How messages are stored in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// MCAP.
    Mcap,
    /// The SQLite database of `rosbag2`.
    Sqlite,
}

/// A file of messages. One that was unpacked goes when the last of its readers has gone.
#[derive(Debug, Clone)]
pub(super) struct Storage {
    pub(super) kind: Kind,
    path: PathBuf,
    _unpacked: Option<Arc<TempPath>>,
}

impl Storage {
    /// Finds the file behind a path, which may be a folder of `rosbag2`, and unpacks it.
    pub(super) fn find(path: &Path) -> Result<Self, RecordingError> {
        let path = if path.is_dir() {
            only_file_in(path)?
        } else {
            path.to_owned()
        };
        let magic = first_bytes(&path)?;
        if !magic.starts_with(&ZSTD_MAGIC) {
            let kind = kind_of(&path, &magic)?;
            return Ok(Self {
                kind,
                path,
                _unpacked: None,
            });
        }
        let unpacked = unpack(&path)?;
        Ok(Self {
            kind: kind_of(&path, &first_bytes(&unpacked)?)?,
            path: unpacked.to_path_buf(),
            _unpacked: Some(Arc::new(unpacked)),
        })
    }

    /// The file to read.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }
}

fn kind_of(path: &Path, magic: &[u8]) -> Result<Kind, RecordingError> {
    let path = path.to_owned();
    if magic.is_empty() {
        return Err(RecordingError::Empty { path });
    }
    if magic.starts_with(mcap::MAGIC) {
        return Ok(Kind::Mcap);
    }
    if magic.starts_with(SQLITE_MAGIC) {
        return Ok(Kind::Sqlite);
    }
    Err(RecordingError::NoRecording { path })
}

fn first_bytes(path: &Path) -> Result<Vec<u8>, RecordingError> {
    let read = || {
        let mut magic = Vec::with_capacity(SQLITE_MAGIC.len());
        let file = File::open(path)?;
        file.take(SQLITE_MAGIC.len() as u64)
            .read_to_end(&mut magic)?;
        Ok(magic)
    };
    read().map_err(|source| io(path, source))
}

/// The one file of messages in a folder.
fn only_file_in(folder: &Path) -> Result<PathBuf, RecordingError> {
    let entries = std::fs::read_dir(folder).map_err(|source| io(folder, source))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.map_err(|source| io(folder, source))?.path();
        let name = path.to_string_lossy();
        if ENDINGS.iter().any(|ending| name.ends_with(ending)) {
            files.push(path);
        }
    }
    let count = files.len();
    match files.pop() {
        Some(only) if count == 1 => Ok(only),
        _ => Err(RecordingError::Folder {
            path: folder.to_owned(),
            count,
        }),
    }
}

/// Unpacks a file beside the system's other temporary files.
fn unpack(path: &Path) -> Result<TempPath, RecordingError> {
    let damaged = |source: std::io::Error| RecordingError::Packed {
        path: path.to_owned(),
        source,
    };
    let packed = File::open(path).map_err(|source| io(path, source))?;
    let reader = zstd::Decoder::new(BufReader::new(packed)).map_err(damaged)?;
    let mut unpacked = NamedTempFile::new().map_err(|source| io(path, source))?;
    let mut limited = reader.take(UNPACKED_BYTES_MAX + 1);
    let copied = std::io::copy(&mut limited, &mut unpacked).map_err(damaged)?;
    if copied > UNPACKED_BYTES_MAX {
        return Err(RecordingError::TooLarge {
            path: path.to_owned(),
        });
    }
    unpacked.flush().map_err(|source| io(path, source))?;
    Ok(unpacked.into_temp_path())
}

fn io(path: &Path, source: std::io::Error) -> RecordingError {
    RecordingError::Io {
        path: path.to_owned(),
        source,
    }
}
