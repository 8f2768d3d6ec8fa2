//! Moments on disk: `ROBOT/ID.mcap` with the data, and `ID.json` with their description, which is
//! written last. A moment without either is an unfinished one of a process that was killed.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use fleetcal_domain::{limits, timestamp};
use fleetcal_fleet::{Held, HeldMessage, Tapped};
use fleetcal_model::{RobotId, RobotTime, WallTime};
use fleetcal_operations::recording_export::RecordingExport;

use crate::{ByRobot, Moment};

/// Ending of data.
const DATA: &str = "mcap";
/// Ending of descriptions.
const DESCRIPTION: &str = "json";
/// Ending of files that are being written.
const PART: &str = "part";

/// Moments on disk.
#[derive(Debug)]
pub(crate) struct Shelf {
    folder: PathBuf,
    moments: ByRobot,
}

impl Shelf {
    /// Makes the folder, reads what is in it, and removes unfinished moments.
    pub(crate) fn read(folder: PathBuf) -> io::Result<Self> {
        fs::create_dir_all(&folder)?;
        let mut moments = BTreeMap::new();
        for entry in fs::read_dir(&folder)? {
            let path = entry?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            // Files of others are left alone.
            if let Ok(robot) = RobotId::parse(&name)
                && path.is_dir()
            {
                moments.insert(robot.clone(), read_robot(&path, &robot)?);
            }
        }
        Ok(Self { folder, moments })
    }

    /// Returns the folder of a robot.
    pub(crate) fn folder(&self, robot: &RobotId) -> PathBuf {
        self.folder.join(robot.as_str())
    }

    /// Returns the path of a moment's data.
    pub(crate) fn file(&self, robot: &RobotId, id: i64) -> PathBuf {
        self.folder(robot).join(format!("{id}.{DATA}"))
    }

    /// Returns a robot's moments, the newest first.
    pub(crate) fn of(&self, robot: &RobotId) -> Vec<Moment> {
        let of = self.moments.get(robot);
        of.into_iter().flatten().rev().cloned().collect()
    }

    /// Returns the number of a robot's next moment: the time in ms, or more.
    pub(crate) fn next_id(&self, robot: &RobotId, now: WallTime) -> i64 {
        let last = self.moments.get(robot).and_then(|of| of.last());
        let after = last.map_or(0, |last| last.id.saturating_add(1));
        (now.0 / 1_000_000).max(after)
    }

    /// Lists a moment that was written, and drops the oldest ones beyond the limits. Returns the
    /// number of dropped ones.
    pub(crate) fn add(&mut self, moment: Moment) -> u64 {
        let robot = moment.robot.clone();
        self.moments.entry(robot.clone()).or_default().push(moment);
        let mut dropped = 0;
        while self.is_too_much_of(&robot) {
            self.drop_oldest(&robot);
            dropped += 1;
        }
        while self.bytes() > limits::MOMENTS_DISK_BYTES_MAX
            && let Some(loser) = self.loser(&robot)
        {
            self.drop_oldest(&loser);
            dropped += 1;
        }
        dropped
    }

    /// True if a robot has more than it may, and more than one.
    fn is_too_much_of(&self, robot: &RobotId) -> bool {
        let Some(of) = self.moments.get(robot).filter(|of| of.len() > 1) else {
            return false;
        };
        of.len() > limits::MOMENTS_OF_ROBOT_MAX
            || bytes_of(of) > limits::MOMENTS_DISK_BYTES_OF_ROBOT_MAX
    }

    /// Returns the robot that loses its oldest moment when all have too much: of those with more
    /// than one moment the one that takes most, else the one with the oldest moment, which is not
    /// `newest`, the robot of the moment just listed.
    fn loser(&self, newest: &RobotId) -> Option<RobotId> {
        let several = self.moments.iter().filter(|(_, of)| of.len() > 1);
        let largest = several.max_by_key(|(_, of)| bytes_of(of));
        let others = || self.moments.iter().filter(|(robot, _)| *robot != newest);
        let oldest = || others().min_by_key(|(_, of)| of.first().map(|first| first.id));
        largest.or_else(oldest).map(|(robot, _)| robot.clone())
    }

    fn bytes(&self) -> u64 {
        self.moments.values().map(|of| bytes_of(of)).sum()
    }

    /// Drops the oldest moment of a robot.
    fn drop_oldest(&mut self, robot: &RobotId) {
        let folder = self.folder(robot);
        let Some(of) = self.moments.get_mut(robot) else {
            return;
        };
        let oldest = of.remove(0);
        if of.is_empty() {
            self.moments.remove(robot);
        }
        for ending in [DESCRIPTION, DATA] {
            remove(&folder.join(format!("{}.{ending}", oldest.id)));
        }
    }
}

/// Removes a file that may be missing.
fn remove(path: &Path) {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            tracing::warn!(%error, path = %path.display(), "a file of a moment was not removed");
        }
        Ok(()) | Err(_) => {}
    }
}

fn bytes_of(moments: &[Moment]) -> u64 {
    moments.iter().map(|moment| moment.bytes).sum()
}

/// Reads a robot's moments, the oldest first, and removes the rest of unfinished ones.
fn read_robot(folder: &Path, robot: &RobotId) -> io::Result<Vec<Moment>> {
    let mut moments = Vec::new();
    let mut data = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        match path.extension().and_then(|ending| ending.to_str()) {
            Some(PART) => fs::remove_file(&path)?,
            Some(DATA) => data.push(path),
            Some(DESCRIPTION) => {
                let read: Result<Moment, _> = serde_json::from_slice(&fs::read(&path)?);
                let whole = read.ok().filter(|moment| {
                    let name = format!("{}.{DESCRIPTION}", moment.id);
                    moment.robot == *robot
                        && path.ends_with(name)
                        && path.with_extension(DATA).is_file()
                });
                match whole {
                    Some(moment) => moments.push(moment),
                    None => fs::remove_file(&path)?,
                }
            }
            _ => {}
        }
    }
    for path in data {
        if !path.with_extension(DESCRIPTION).is_file() {
            fs::remove_file(&path)?;
        }
    }
    moments.sort_by_key(|moment| moment.id);
    Ok(moments)
}

/// Writes a moment. On return it survives the end of the process and of the machine, or, after an
/// error, nothing of it is left. Returns its description with what the data say.
pub(crate) fn write(folder: &Path, moment: Moment, held: &Held) -> io::Result<Moment> {
    let id = moment.id;
    let written = write_whole(folder, moment, held);
    if written.is_err() {
        for ending in [DESCRIPTION, DATA] {
            let (part, path) = places(folder, id, ending);
            remove(&part);
            remove(&path);
        }
    }
    written
}

fn write_whole(folder: &Path, mut moment: Moment, held: &Held) -> io::Result<Moment> {
    fs::create_dir_all(folder)?;
    let (part, path) = places(folder, moment.id, DATA);
    let stamps = || held.messages().map(|message| message.stamp);
    moment.from = timestamp::of_robot(stamps().min().unwrap_or(RobotTime(0)));
    moment.to = timestamp::of_robot(stamps().max().unwrap_or(RobotTime(0)));
    moment.messages = stamps().count() as u64;
    write_data(&part, &moment.robot, held)?;
    moment.bytes = fs::metadata(&part)?.len();
    fs::rename(&part, &path)?;

    let (part, path) = places(folder, moment.id, DESCRIPTION);
    let file = File::create(&part)?;
    serde_json::to_writer_pretty(&file, &moment)?;
    file.sync_all()?;
    fs::rename(&part, &path)?;
    File::open(folder)?.sync_all()?;
    if let Some(parent) = folder.parent() {
        File::open(parent)?.sync_all()?;
    }
    Ok(moment)
}

/// Returns the place of a file while it is written, and afterwards.
fn places(folder: &Path, id: i64, ending: &str) -> (PathBuf, PathBuf) {
    let path = folder.join(format!("{id}.{ending}"));
    let part = folder.join(format!("{id}.{ending}.{PART}"));
    (part, path)
}

/// Item of a recording, by its stamp.
enum Item<'a> {
    Message(HeldMessage<'a>),
    Found(&'a Tapped),
}

impl Item<'_> {
    fn stamp(&self) -> RobotTime {
        match self {
            Self::Message(message) => message.stamp,
            Self::Found(found) => match found {
                Tapped::Message { stamp, .. } | Tapped::Pose(stamp, _) => *stamp,
                Tapped::Estimate(document) => document.stamp_ns,
                Tapped::Change(change) => change.stamp_ns,
                Tapped::Event { stamp_ns, .. } => *stamp_ns,
            },
        }
    }
}

/// Writes a recording in the order of the stamps, and waits for the disk.
fn write_data(path: &Path, robot: &RobotId, held: &Held) -> io::Result<()> {
    let mut items: Vec<Item<'_>> = held.messages().map(Item::Message).collect();
    items.extend(held.found().iter().map(Item::Found));
    items.sort_by_key(Item::stamp);
    let mut export = RecordingExport::create(path, robot).map_err(io::Error::other)?;
    for item in items {
        let written = match item {
            Item::Message(message) => export.message(message.stamp, message.topic, message.payload),
            Item::Found(found) => export.tapped(found),
        };
        written.map_err(io::Error::other)?;
    }
    export.finish_on_disk().map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MomentKind;

    fn moment(robot: &str, id: i64) -> Moment {
        Moment {
            id,
            robot: RobotId::parse(robot).unwrap(),
            kept_at: timestamp::of(WallTime(id * 1_000_000)),
            kind: MomentKind::Requested,
            note: "odd noise".to_owned(),
            from: timestamp::of_robot(RobotTime(0)),
            to: timestamp::of_robot(RobotTime(0)),
            messages: 0,
            bytes: 0,
        }
    }

    fn ids(shelf: &Shelf, robot: &str) -> Vec<i64> {
        let of = shelf.of(&RobotId::parse(robot).unwrap());
        of.iter().map(|moment| moment.id).collect()
    }

    #[test]
    fn what_was_written_is_read_again_and_what_was_not_finished_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let of_robot = folder.path().join("a");
        let written = write(&of_robot, moment("a", 7), &Held::default()).unwrap();
        assert!(written.bytes > 0);
        for name in ["8.mcap", "9.json", "10.mcap.part", "11.json.part"] {
            fs::write(of_robot.join(name), "{").unwrap();
        }
        // One that lies in another robot's folder, or under another number.
        let text = fs::read(of_robot.join("7.json")).unwrap();
        fs::write(of_robot.join("12.json"), &text).unwrap();
        fs::write(of_robot.join("12.mcap"), "").unwrap();
        fs::write(of_robot.join("note.txt"), "of a person").unwrap();
        let shelf = Shelf::read(folder.path().to_owned()).unwrap();
        assert_eq!(shelf.of(&written.robot), [written]);
        let left = fs::read_dir(&of_robot).unwrap();
        let mut left: Vec<_> = left.map(|entry| entry.unwrap().file_name()).collect();
        left.sort();
        assert_eq!(left, ["7.json", "7.mcap", "note.txt"]);
    }

    #[test]
    fn the_oldest_of_a_robot_is_dropped_and_of_all_that_of_the_largest() {
        let folder = tempfile::tempdir().unwrap();
        let mut shelf = Shelf::read(folder.path().to_owned()).unwrap();
        let most = limits::MOMENTS_OF_ROBOT_MAX as i64;
        let mut dropped = 0;
        for id in 1..=most + 3 {
            let written = write(
                &shelf.folder(&moment("a", id).robot),
                moment("a", id),
                &Held::default(),
            );
            dropped += shelf.add(written.unwrap());
        }
        assert_eq!(dropped, 3);
        assert_eq!(ids(&shelf, "a"), (4..=most + 3).rev().collect::<Vec<i64>>());
        let again = Shelf::read(folder.path().to_owned()).unwrap();
        assert_eq!(ids(&again, "a"), ids(&shelf, "a"));
        // Beyond the size of a robot the newest stays, whatever its own size.
        let mut large = moment("b", 1);
        large.bytes = limits::MOMENTS_DISK_BYTES_OF_ROBOT_MAX + 1;
        assert_eq!(shelf.add(large.clone()), 0);
        large.id = 2;
        assert_eq!(shelf.add(large), 1);
        assert_eq!(ids(&shelf, "b"), [2]);
        // Beyond the size of all, each robot that has the most loses its oldest.
        let mut robots = 0;
        while shelf.bytes() + limits::MOMENTS_DISK_BYTES_OF_ROBOT_MAX
            <= limits::MOMENTS_DISK_BYTES_MAX
        {
            let mut half = moment(&format!("c{robots}"), 1);
            half.bytes = limits::MOMENTS_DISK_BYTES_OF_ROBOT_MAX / 2;
            shelf.add(half.clone());
            half.id = 2;
            assert_eq!(shelf.add(half), 0);
            robots += 1;
        }
        let mut last = moment("d", 1);
        last.bytes = limits::MOMENTS_DISK_BYTES_OF_ROBOT_MAX;
        assert_eq!(shelf.add(last), 1);
        assert_eq!(ids(&shelf, "d"), [1]);
        assert!(shelf.bytes() <= limits::MOMENTS_DISK_BYTES_MAX);
    }

    #[test]
    fn a_robot_with_one_large_moment_leaves_the_limit_of_all_in_force() {
        let folder = tempfile::tempdir().unwrap();
        let mut shelf = Shelf::read(folder.path().to_owned()).unwrap();
        let mut next = 0;
        let mut sized = |robot: &str, bytes| {
            next += 1;
            Moment {
                bytes,
                ..moment(robot, next)
            }
        };
        let small = limits::MOMENTS_DISK_BYTES_OF_ROBOT_MAX / 4;
        let third = (limits::MOMENTS_DISK_BYTES_MAX - small) / 3;
        shelf.add(sized("one", third));
        for _ in 0..3 {
            let written = sized("several", small);
            assert_eq!(shelf.add(written), 0);
        }
        shelf.add(sized("two", third));
        assert_eq!(shelf.add(sized("three", third)), 2);
        assert_eq!(
            (ids(&shelf, "one"), ids(&shelf, "several")),
            (vec![1], vec![4])
        );
        assert!(shelf.bytes() <= limits::MOMENTS_DISK_BYTES_MAX);
        // Nobody has several: the oldest of all goes.
        assert_eq!(shelf.add(sized("four", third)), 1);
        let left = ["one", "several", "two", "three", "four"].map(|robot| ids(&shelf, robot).len());
        assert_eq!(left, [0, 1, 1, 1, 1]);
        assert!(shelf.bytes() <= limits::MOMENTS_DISK_BYTES_MAX);
    }

    #[test]
    fn a_moment_that_the_disk_refuses_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        for ending in [DATA, DESCRIPTION] {
            let (part, _) = places(folder.path(), 7, ending);
            // A device on which every write fails with ENOSPC.
            std::os::unix::fs::symlink("/dev/full", part).unwrap();
            let error = write(folder.path(), moment("a", 7), &Held::default()).unwrap_err();
            assert!(error.to_string().contains("No space left"), "{error}");
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "{ending}");
        }
    }
}
