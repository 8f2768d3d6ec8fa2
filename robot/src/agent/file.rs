//! The file that the robot's software reads, and the memory beside it: each replaced as a whole or
//! not at all.

use std::ffi::OsString;
use std::fs::{self, File, Metadata, OpenOptions, Permissions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _, fchown};
use std::path::{Path, PathBuf};

use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationValues;
use rustix::fs::OFlags;
use thiserror::Error;

use super::state::Memory;

/// Longest file that is read, bytes.
const FILE_BYTES_MAX: u64 = 256 * 1024;
/// Mode of a file that did not exist before: everybody may read it, as other programs of the robot
/// do.
const MODE: u32 = 0o644;
/// Bit of a mode by which everybody may read.
const READABLE_BY_ALL: u32 = 0o004;
/// Suffix of a file's name until it is whole.
const TEMPORARY_ENDING: &str = ".agent.tmp";
/// Suffix of the memory's file behind the applied file's name.
const MEMORY_ENDING: &str = ".agent.json";
/// Suffix of the lock: one agent for a file.
const LOCK_ENDING: &str = ".agent.lock";

/// Reason for which a file of the agent cannot be used.
#[derive(Debug, Error)]
pub enum FileError {
    /// The file's suffix names no known format.
    #[error("file to apply: got {}, expected a name ending in .yaml, .yml or .json", path.display())]
    Format {
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
    /// The file is longer than a calibration can be.
    #[error("{} is longer than 262144 bytes: is it the calibration's file?", path.display())]
    TooLong {
        /// The file.
        path: PathBuf,
    },
    /// The memory cannot be parsed.
    #[error("{}: {reason}; move it away to begin again", path.display())]
    Memory {
        /// The file.
        path: PathBuf,
        /// Fault of the memory.
        reason: String,
    },
    /// The memory is that of another robot.
    #[error("{} is of robot {found}, this one is {robot}: another file is needed", path.display())]
    OtherRobot {
        /// The file.
        path: PathBuf,
        /// Robot of the memory.
        found: RobotId,
        /// Robot of this agent.
        robot: RobotId,
    },
    /// Two files that the agent was to write are the same.
    #[error("{} is named for two of the agent's files, expected another file for each", path.display())]
    Twice {
        /// The file.
        path: PathBuf,
    },
    /// An additional file that the agent was to write exists and was not written by it.
    #[error("{} was not written by this agent, which would replace it: move it away", path.display())]
    NotOurs {
        /// The file.
        path: PathBuf,
    },
    /// A file of other software lacks the place for the LiDAR's pose.
    #[error("{}: {reason}", path.display())]
    NoPlace {
        /// The file.
        path: PathBuf,
        /// Missing part.
        reason: String,
    },
    /// The file is in use by another agent.
    #[error("{}: another agent works on this file", path.display())]
    Locked {
        /// The lock.
        path: PathBuf,
    },
    /// The values cannot be written in the file's format.
    #[error("{}: {reason}", path.display())]
    Values {
        /// The file.
        path: PathBuf,
        /// Reason.
        reason: String,
    },
}

/// Format of written values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Yaml,
    Json,
}

/// The file to apply, with the memory beside it. While this value exists, no other agent can open
/// it.
#[derive(Debug)]
pub(super) struct AppliedFile {
    path: PathBuf,
    format: Format,
    _lock: File,
}

impl AppliedFile {
    /// Opens the file, which need not exist yet. A link is followed.
    pub fn open(path: &Path) -> Result<Self, FileError> {
        let format = match path.extension().and_then(|ending| ending.to_str()) {
            Some("yaml" | "yml") => Format::Yaml,
            Some("json") => Format::Json,
            _ => {
                return Err(FileError::Format {
                    path: path.to_owned(),
                });
            }
        };
        let path = match fs::canonicalize(path) {
            Ok(path) => path,
            Err(error) if error.kind() == io::ErrorKind::NotFound => path.to_owned(),
            Err(error) => return Err(at(path)(error)),
        };
        let lock_path = beside(&path, LOCK_ENDING);
        let lock = open_lock(&lock_path).map_err(at(&lock_path))?;
        lock.try_lock().map_err(|error| match error {
            fs::TryLockError::WouldBlock => FileError::Locked {
                path: lock_path.clone(),
            },
            fs::TryLockError::Error(error) => at(&lock_path)(error),
        })?;
        Ok(Self {
            path,
            format,
            _lock: lock,
        })
    }

    /// Returns its path, with links followed.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the agent's own files: this one, the memory and the lock beside it.
    pub fn own(&self) -> [PathBuf; 3] {
        let lock = beside(&self.path, LOCK_ENDING);
        [self.path.clone(), self.memory_path(), lock]
    }

    /// Returns its content; `None` if it does not exist.
    pub fn read(&self) -> Result<Option<String>, FileError> {
        read(&self.path)
    }

    /// Parses the values in a text of this format; `None` if the text is not one.
    pub fn values_in(&self, text: &str) -> Option<CalibrationValues> {
        match self.format {
            Format::Yaml => serde_saphyr::from_str(text).ok(),
            Format::Json => serde_json::from_str(text).ok(),
        }
    }

    /// Formats these values.
    pub fn text_of(&self, values: &CalibrationValues) -> Result<String, FileError> {
        let text = match self.format {
            Format::Yaml => serde_saphyr::to_string(values).map_err(|error| error.to_string()),
            Format::Json => serde_json::to_string_pretty(values)
                .map(|text| text + "\n")
                .map_err(|error| error.to_string()),
        };
        text.map_err(|reason| FileError::Values {
            path: self.path.clone(),
            reason,
        })
    }

    /// Replaces its content, and reads it back.
    pub fn write(&self, text: &str) -> Result<(), FileError> {
        replace(&self.path, text)?;
        if self.read()?.as_deref() != Some(text) {
            let other = io::Error::other("it does not say what was written: who else writes it?");
            return Err(at(&self.path)(other));
        }
        Ok(())
    }

    /// Restores its former content; `None` removes it.
    pub fn restore(&self, before: Option<&str>) -> Result<(), FileError> {
        if self.read()?.as_deref() == before {
            return Ok(());
        }
        let Some(text) = before else {
            fs::remove_file(&self.path).map_err(at(&self.path))?;
            return sync_folder(&self.path);
        };
        self.write(text)
    }

    /// Returns the agent's memory; `None` at the first start.
    pub fn memory(&self, robot: &RobotId) -> Result<Option<Memory>, FileError> {
        let path = self.memory_path();
        let Some(text) = read(&path)? else {
            return Ok(None);
        };
        let memory: Memory = serde_json::from_str(&text).map_err(|error| FileError::Memory {
            path: path.clone(),
            reason: error.to_string(),
        })?;
        if memory.robot != *robot {
            return Err(FileError::OtherRobot {
                path,
                found: memory.robot,
                robot: robot.clone(),
            });
        }
        Ok(Some(memory))
    }

    /// Stores the agent's memory.
    pub fn remember(&self, memory: &Memory) -> Result<(), FileError> {
        let path = self.memory_path();
        let text = serde_json::to_string_pretty(memory).map_err(|error| FileError::Memory {
            path: path.clone(),
            reason: error.to_string(),
        })?;
        replace(&path, &text)
    }

    fn memory_path(&self) -> PathBuf {
        beside(&self.path, MEMORY_ENDING)
    }
}

fn at(path: &Path) -> impl Fn(io::Error) -> FileError {
    move |source| FileError::Io {
        path: path.to_owned(),
        source,
    }
}

pub(super) fn beside(path: &Path, ending: &str) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(ending);
    PathBuf::from(name)
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Returns the present or future path of a file, with links followed.
pub(super) fn resolved(path: &Path) -> PathBuf {
    let whole = fs::canonicalize(path).ok();
    let in_folder = || {
        Some(
            fs::canonicalize(folder_of(path))
                .ok()?
                .join(path.file_name()?),
        )
    };
    whole.or_else(in_folder).unwrap_or_else(|| path.to_owned())
}

/// Returns the content of a file; `None` if it does not exist.
pub(super) fn read(path: &Path) -> Result<Option<String>, FileError> {
    let file = match File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(at(path)(error)),
    };
    let mut text = String::new();
    let read = file.take(FILE_BYTES_MAX + 1).read_to_string(&mut text);
    if read.map_err(at(path))? as u64 > FILE_BYTES_MAX {
        return Err(FileError::TooLong {
            path: path.to_owned(),
        });
    }
    Ok(Some(text))
}

/// Removes a file, which need not exist.
pub(super) fn remove(path: &Path) -> Result<(), FileError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(at(path)(error)),
        _ => Ok(()),
    }
}

/// Replaces a file by temporary file, fsync, rename, and fsync of the folder: after a power loss it
/// has the old text or the new one. The readers of the old file can read the new one.
pub(super) fn replace(path: &Path, text: &str) -> Result<(), FileError> {
    let temporary = beside(path, TEMPORARY_ENDING);
    let replaced = write_new(&temporary, text, fs::metadata(path).ok().as_ref())
        .and_then(|()| fs::rename(&temporary, path));
    if let Err(source) = replaced {
        // Whatever is left of it goes before the next one.
        fs::remove_file(&temporary).ok();
        return Err(at(path)(source));
    }
    sync_folder(path)
}

/// Opens the lock, which is empty. A link in its place is refused: in a folder that others can
/// write it could name any file of the agent's user. So is anything that is not a file and might
/// block.
fn open_lock(path: &Path) -> io::Result<File> {
    let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK;
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(false).mode(MODE);
    #[expect(
        clippy::cast_possible_wrap,
        reason = "the system's flags are small bits"
    )]
    options.custom_flags(flags.bits() as i32);
    let lock = options.open(path).map_err(|error| {
        if fs::symlink_metadata(path).is_ok_and(|found| found.is_symlink()) {
            io::Error::other("is a link, which the agent does not follow: remove it")
        } else {
            error
        }
    })?;
    if !lock.metadata()?.is_file() {
        return Err(io::Error::other("is no file: remove it"));
    }
    Ok(lock)
}

/// Writes a file with the access rights of the one before it. A killed agent's remainder is removed
/// first; the lock keeps every other agent away, and a link under the name is not followed.
fn write_new(path: &Path, text: &str, before: Option<&Metadata>) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    let mut file = OpenOptions::new().write(true).create_new(true).open(path)?;
    file.write_all(text.as_bytes())?;
    if let Some(before) = before {
        keep_owner(&file, before)?;
    }
    let mode = before.map_or(MODE, |before| before.permissions().mode());
    file.set_permissions(Permissions::from_mode(mode))?;
    file.sync_all()
}

/// Keeps the owner of the file before. An agent without the right to change owners continues only
/// where everybody may read both.
fn keep_owner(file: &File, before: &Metadata) -> io::Result<()> {
    let now = file.metadata()?;
    if (now.uid(), now.gid()) == (before.uid(), before.gid()) {
        return Ok(());
    }
    match fchown(file, Some(before.uid()), Some(before.gid())) {
        Err(error)
            if error.kind() == io::ErrorKind::PermissionDenied
                && before.permissions().mode() & READABLE_BY_ALL != 0 =>
        {
            Ok(())
        }
        result => result,
    }
}

fn sync_folder(path: &Path) -> Result<(), FileError> {
    let folder = folder_of(path);
    let synced = File::open(folder).and_then(|folder| folder.sync_all());
    synced.map_err(at(folder))
}

#[cfg(test)]
mod tests {
    use fleetcal_model::RobotTime;

    use super::*;

    fn values() -> CalibrationValues {
        CalibrationValues {
            steering_offset_rad: -1e-7,
            lidar_x_m: 1.0,
            lidar_y_m: -0.016,
            lidar_yaw_rad: 0.0133,
            speed_scale: Some(1.002),
            ..CalibrationValues::default()
        }
    }

    #[test]
    fn values_are_written_by_the_files_ending_and_read_back() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.yaml", "b.yml", "c.json"] {
            let path = folder.path().join(name);
            let file = AppliedFile::open(&path).unwrap();
            assert_eq!(file.read().unwrap(), None);
            let text = file.text_of(&values()).unwrap();
            file.write(&text).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
            assert_eq!(file.values_in(&text), Some(values()));
            file.restore(None).unwrap();
            assert!(!path.exists());
        }
        let sentence = AppliedFile::open(Path::new("a.toml"))
            .unwrap_err()
            .to_string();
        assert!(
            sentence.contains("a.toml") && sentence.contains(".yaml"),
            "{sentence}"
        );
    }

    /// Checks numbers for YAML 1.1, which ROS 2 reads: it takes `1` for an integer and `1e-7` for a
    /// string.
    #[test]
    fn every_number_in_yaml_has_a_point() {
        let folder = tempfile::tempdir().unwrap();
        let file = AppliedFile::open(&folder.path().join("a.yaml")).unwrap();
        let text = file.text_of(&values()).unwrap();
        let expected = "steering_offset_rad: -1.0e-7\nlidar_x_m: 1.0\nlidar_y_m: -0.016\n\
                        lidar_yaw_rad: 0.0133\nspeed_scale: 1.002\n";
        assert_eq!(text, expected);
    }

    #[test]
    fn a_file_by_hand_is_read_and_foreign_text_is_kept_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hand.yaml");
        let by_hand =
            "# by Ana\nlidar_x_m: 1\nlidar_y_m: 0\nlidar_yaw_rad: 0.0\nsteering_offset_rad: .02\n";
        fs::write(&path, by_hand).unwrap();
        fs::set_permissions(&path, Permissions::from_mode(0o640)).unwrap();
        let file = AppliedFile::open(&path).unwrap();
        let read = file.values_in(by_hand).unwrap();
        assert!((read.steering_offset_rad - 0.02).abs() < 1e-12 && read.wheelbase_m.is_none());
        assert_eq!(file.values_in("wheels: 4\n"), None);
        file.write(&file.text_of(&values()).unwrap()).unwrap();
        let mode = fs::metadata(&path).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o640);
        // Only root may give a file away; it stays its former owner's then.
        let given = std::os::unix::fs::chown(&path, Some(12_345), Some(12_345)).is_ok();
        fs::write(beside(&path, TEMPORARY_ENDING), "left by a killed agent").unwrap();
        file.write(&file.text_of(&values()).unwrap()).unwrap();
        assert_eq!(fs::metadata(&path).unwrap().uid() == 12_345, given);
        assert!(!beside(&path, TEMPORARY_ENDING).exists());
        file.restore(Some(by_hand)).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), by_hand);
    }

    #[test]
    fn a_file_has_one_agent_and_one_robot() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        let file = AppliedFile::open(&path).unwrap();
        assert!(matches!(
            AppliedFile::open(&path),
            Err(FileError::Locked { .. })
        ));
        let [robot, other] = ["tugger_01", "tugger_02"].map(|id| RobotId::parse(id).unwrap());
        assert_eq!(file.memory(&robot).unwrap(), None);
        let held = crate::agent::state::Held::factory(Some(values()), RobotTime(7));
        let memory = Memory::new(robot.clone(), held);
        file.remember(&memory).unwrap();
        assert_eq!(file.memory(&robot).unwrap(), Some(memory));
        assert!(matches!(
            file.memory(&other),
            Err(FileError::OtherRobot { .. })
        ));
        fs::write(beside(&path, MEMORY_ENDING), "{\"schema\": 1").unwrap();
        let sentence = file.memory(&robot).unwrap_err().to_string();
        assert!(sentence.contains("move it away"), "{sentence}");
        fs::write(&path, vec![b' '; FILE_BYTES_MAX as usize + 1]).unwrap();
        assert!(matches!(file.read(), Err(FileError::TooLong { .. })));
    }

    #[test]
    fn a_link_in_the_locks_place_is_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (path, other) = (folder.path().join("a.json"), folder.path().join("other"));
        fs::write(&other, "somebody's").unwrap();
        for target in [other.clone(), folder.path().join("none")] {
            let lock = beside(&path, LOCK_ENDING);
            std::os::unix::fs::symlink(&target, &lock).unwrap();
            let sentence = AppliedFile::open(&path).unwrap_err().to_string();
            assert!(sentence.contains("is a link"), "{sentence}");
            fs::remove_file(&lock).unwrap();
        }
        assert_eq!(fs::read_to_string(&other).unwrap(), "somebody's");
        assert!(!folder.path().join("none").exists());
    }

    #[test]
    fn a_link_is_followed_and_a_folder_that_is_missing_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let (real, link) = (
            folder.path().join("real.json"),
            folder.path().join("link.json"),
        );
        fs::write(&real, "{}").unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        AppliedFile::open(&link).unwrap().write("[]").unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read_to_string(&real).unwrap(), "[]");
        let missing = folder.path().join("none/a.json");
        let sentence = AppliedFile::open(&missing).unwrap_err().to_string();
        assert!(sentence.contains("none/a.json"), "{sentence}");
    }
}
