//! Files that hold a recording's messages, and their kinds.
//!
//! `rosbag2` writes a folder with a file of messages in it, as MCAP or as an SQLite database
//! (`.db3`), either of which may be packed as a whole with zstd. A recording that was split has
//! several, whose order is that of `metadata.yaml`.

use std::fs::File;
use std::io::{BufReader, Read, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Deserialize;
use tempfile::{NamedTempFile, TempPath};

use super::{FILES_MAX, METADATA_BYTES_MAX, RecordingError, UNPACKED_BYTES_MAX};

/// File of `rosbag2`'s metadata in a folder.
const METADATA: &str = "metadata.yaml";

/// First bytes of a file packed with zstd, and of a message that was packed by itself.
pub(super) const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
/// First bytes of an SQLite database.
const SQLITE_MAGIC: &[u8] = b"SQLite format 3\0";
/// First bytes of a ROS 1 bag.
const ROS1_MAGIC: &[u8] = b"#ROSBAG V";
/// Suffixes of the files that hold messages.
const ENDINGS: [&str; 4] = [".mcap", ".db3", ".mcap.zstd", ".db3.zstd"];

/// Storage format of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// MCAP.
    Mcap,
    /// The SQLite database of `rosbag2`.
    Sqlite,
}

/// A file of messages. An unpacked one is removed with the last of its readers.
#[derive(Debug, Clone)]
pub(super) struct Storage {
    pub(super) kind: Kind,
    original: PathBuf,
    unpacked: Option<Arc<TempPath>>,
}

impl Storage {
    /// Finds the files at a path, which may be a folder of `rosbag2`, and unpacks them. They are in
    /// the order of recording.
    pub(super) fn find(path: &Path) -> Result<Vec<Self>, RecordingError> {
        let files = if path.is_dir() {
            files_in(path)?
        } else {
            vec![path.to_owned()]
        };
        let mut room = UNPACKED_BYTES_MAX;
        let of = |file| Self::of_file(file, &mut room);
        files.into_iter().map(of).collect()
    }

    /// Opens one file; unpacking reduces `room`.
    fn of_file(path: PathBuf, room: &mut u64) -> Result<Self, RecordingError> {
        let magic = first_bytes(&path)?;
        if !magic.starts_with(&ZSTD_MAGIC) {
            let kind = kind_of(&path, &magic)?;
            return Ok(Self {
                kind,
                original: path,
                unpacked: None,
            });
        }
        let unpacked = unpack(&path, room)?;
        Ok(Self {
            kind: kind_of(&path, &first_bytes(&unpacked)?)?,
            original: path,
            unpacked: Some(Arc::new(unpacked)),
        })
    }

    /// Returns the file to read.
    pub(super) fn path(&self) -> &Path {
        match &self.unpacked {
            Some(unpacked) => unpacked,
            None => &self.original,
        }
    }

    /// Returns the recorded file, packed or not.
    pub(super) fn original(&self) -> &Path {
        &self.original
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
    if magic.starts_with(ROS1_MAGIC) {
        return Err(RecordingError::Ros1 { path });
    }
    Err(RecordingError::NoRecording { path })
}

/// Returns the beginning of a file. A pipe, which waits for a writer when it is opened, is none.
fn first_bytes(path: &Path) -> Result<Vec<u8>, RecordingError> {
    let file = std::fs::metadata(path).map_err(|source| io(path, source))?;
    if !file.is_file() {
        let path = path.to_owned();
        return Err(RecordingError::NoRecording { path });
    }
    let read = || {
        let mut magic = Vec::with_capacity(SQLITE_MAGIC.len());
        let file = File::open(path)?;
        file.take(SQLITE_MAGIC.len() as u64)
            .read_to_end(&mut magic)?;
        Ok(magic)
    };
    read().map_err(|source| io(path, source))
}

/// Returns the files of messages in a folder, in their order.
fn files_in(folder: &Path) -> Result<Vec<PathBuf>, RecordingError> {
    let entries = std::fs::read_dir(folder).map_err(|source| io(folder, source))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.map_err(|source| io(folder, source))?.path();
        if has_messages(&path) {
            files.push(path);
        }
    }
    let metadata = folder.join(METADATA);
    match (files.len(), metadata.is_file()) {
        // A file that was renamed is still the only one.
        (1, true) if names_one(&metadata)? => Ok(files),
        (1, false) => Ok(files),
        (1..=FILES_MAX, true) => split_files(folder, &metadata, &files),
        (count, _) => Err(RecordingError::Folder {
            path: folder.to_owned(),
            count,
        }),
    }
}

/// True if a file of a folder is one of messages, by its name.
fn has_messages(path: &Path) -> bool {
    let name = path.to_string_lossy();
    ENDINGS.iter().any(|ending| name.ends_with(ending))
}

/// Returns the other files of messages in the folder of one, in the order of recording if
/// `rosbag2` wrote it, else of their names; at most [`FILES_MAX`]. The second value is true for a
/// split recording of `rosbag2`, whose files are of one robot's drive.
pub(super) fn files_beside(file: &Path) -> (Vec<PathBuf>, bool) {
    let folder = match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    let mut present: Vec<PathBuf> = paths.filter(|path| has_messages(path)).collect();
    present.sort();
    let metadata = folder.join(METADATA);
    let split = split_files(folder, &metadata, &present);
    let (mut files, is_split) = match split {
        Ok(files) if metadata.is_file() => (files, true),
        _ => (present, false),
    };
    files.retain(|other| other.file_name() != file.file_name());
    files.truncate(FILES_MAX);
    (files, is_split)
}

/// True if `rosbag2` wrote a file into a folder: the metadata, or one of messages.
pub(super) fn is_of_bag(folder: &Path, file: &Path) -> bool {
    let metadata = folder.join(METADATA);
    let is_of_it = file == metadata || has_messages(file);
    file.parent() == Some(folder) && metadata.is_file() && is_of_it
}

/// Part of `metadata.yaml` with the order of a split recording's files.
#[derive(Deserialize)]
struct Metadata {
    rosbag2_bagfile_information: Information,
}

#[derive(Deserialize)]
struct Information {
    relative_file_paths: Vec<PathBuf>,
}

impl Information {
    /// Reads a `metadata.yaml`.
    fn read(metadata: &Path) -> Result<Self, RecordingError> {
        let mut text = String::new();
        let file = File::open(metadata).map_err(|source| io(metadata, source))?;
        let read = file.take(METADATA_BYTES_MAX + 1).read_to_string(&mut text);
        if read.map_err(|source| io(metadata, source))? as u64 > METADATA_BYTES_MAX {
            let reason = format!("longer than {METADATA_BYTES_MAX} bytes");
            return Err(refused(metadata, reason));
        }
        let known: Metadata = serde_saphyr::from_str(&text).map_err(|error| {
            let reason = error.to_string().lines().take(1).collect();
            refused(metadata, reason)
        })?;
        Ok(known.rosbag2_bagfile_information)
    }
}

fn refused(metadata: &Path, reason: String) -> RecordingError {
    RecordingError::Metadata {
        path: metadata.to_owned(),
        reason,
    }
}

/// True if the metadata name at most one file of messages.
fn names_one(metadata: &Path) -> Result<bool, RecordingError> {
    let known = Information::read(metadata)?;
    Ok(known.relative_file_paths.len() <= 1)
}

/// Returns the files that the metadata name, in that order. All of them have to exist, and no
/// others.
fn split_files(
    folder: &Path,
    metadata: &Path,
    present: &[PathBuf],
) -> Result<Vec<PathBuf>, RecordingError> {
    let known = Information::read(metadata)?;
    let refused = |reason| refused(metadata, reason);
    let mut files = Vec::new();
    for named in known.relative_file_paths {
        // Some recorders put the folder's own name in front.
        let file = named.file_name().map(|name| folder.join(name));
        let file = file.filter(|file| present.contains(file) && !files.contains(file));
        files.push(file.ok_or_else(|| {
            refused(format!(
                "relative_file_paths: got {}, expected the folder's files, each once",
                named.display()
            ))
        })?);
    }
    if let Some(other) = present.iter().find(|&file| !files.contains(file)) {
        return Err(refused(format!(
            "relative_file_paths lacks {}, which lies beside it",
            other.display()
        )));
    }
    Ok(files)
}

/// Unpacks a file beside the system's other temporary files, as long as there is room.
fn unpack(path: &Path, room: &mut u64) -> Result<TempPath, RecordingError> {
    let damaged = |source: std::io::Error| RecordingError::Packed {
        path: path.to_owned(),
        source,
    };
    let packed = File::open(path).map_err(|source| io(path, source))?;
    let reader = zstd::Decoder::new(BufReader::new(packed)).map_err(damaged)?;
    let mut unpacked = NamedTempFile::new().map_err(|source| io(path, source))?;
    let mut limited = reader.take(*room + 1);
    let copied = std::io::copy(&mut limited, &mut unpacked).map_err(damaged)?;
    *room = room
        .checked_sub(copied)
        .ok_or_else(|| RecordingError::TooLarge {
            path: path.to_owned(),
        })?;
    unpacked.flush().map_err(|source| io(path, source))?;
    Ok(unpacked.into_temp_path())
}

fn io(path: &Path, source: std::io::Error) -> RecordingError {
    RecordingError::Io {
        path: path.to_owned(),
        source,
    }
}
