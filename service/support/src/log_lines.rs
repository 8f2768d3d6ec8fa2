//! Latest log lines of each robot, beside the log itself.

use std::collections::{BTreeMap, VecDeque};
use std::io::{self, Write};
use std::sync::{Mutex, MutexGuard, PoisonError};

use fleetcal_limits::{LOG_LINE_BYTES_MAX, LOG_LINES_OF_ROBOT_MAX, LOG_LINES_ROBOTS_MAX};
use fleetcal_model::RobotId;

/// Field by which a line names its robot.
const FIELD: &str = "robot.id=";

/// Lines of each robot, the oldest first. There is one log of a process, and so one of these.
static LINES: Mutex<BTreeMap<RobotId, VecDeque<String>>> = Mutex::new(BTreeMap::new());

/// Returns the latest log lines about a robot, the oldest first.
pub fn lines_of(robot: &RobotId) -> Vec<String> {
    let lines = lines();
    lines.get(robot).into_iter().flatten().cloned().collect()
}

/// Locks the lines. They are whole after every statement, so the panic of another thread is no reason
/// to stop.
fn lines() -> MutexGuard<'static, BTreeMap<RobotId, VecDeque<String>>> {
    LINES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Writer of the log that remembers the lines about robots. Each write is a whole line.
#[derive(Debug)]
pub struct Remembering<W>(pub W);

impl<W: Write> Write for Remembering<W> {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        remember(&String::from_utf8_lossy(line));
        self.0.write(line)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

fn remember(line: &str) {
    let line = without_colours(line.trim_end());
    let Some(robot) = robot_of(&line) else {
        return;
    };
    let end = line.floor_char_boundary(LOG_LINE_BYTES_MAX);
    let line = line.get(..end).unwrap_or_default().to_owned();
    let mut all = lines();
    if !all.contains_key(&robot) && all.len() >= LOG_LINES_ROBOTS_MAX {
        all.pop_first();
    }
    let of_robot = all.entry(robot).or_default();
    if of_robot.len() >= LOG_LINES_OF_ROBOT_MAX {
        of_robot.pop_front();
    }
    of_robot.push_back(line);
}

/// Returns the robot that a line is about.
fn robot_of(line: &str) -> Option<RobotId> {
    let (_, behind) = line.split_once(FIELD)?;
    let id = behind.split(|c: char| !c.is_ascii_alphanumeric() && c != '_' && c != '-');
    RobotId::parse(id.into_iter().next()?).ok()
}

/// Removes the colours of a terminal: an escape up to the `m` after it.
fn without_colours(line: &str) -> String {
    let mut parts = line.split('\u{1b}');
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |text, part| {
        text + part.split_once('m').map_or(part, |(_, rest)| rest)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(robot: &str) -> Vec<String> {
        lines_of(&RobotId::parse(robot).unwrap())
    }

    #[test]
    fn the_latest_lines_about_a_robot_are_remembered_and_all_are_written() {
        let mut written = Vec::new();
        let mut log = Remembering(&mut written);
        for number in 0..LOG_LINES_OF_ROBOT_MAX + 2 {
            writeln_whole(
                &mut log,
                &format!("WARN note {number} robot.id=agv_7 late=1\n"),
            );
        }
        writeln_whole(&mut log, "INFO ready http=127.0.0.1\n");
        let coloured =
            "\u{1b}[33mWARN\u{1b}[0m odd \u{1b}[3mrobot.id\u{1b}[0m\u{1b}[2m=\u{1b}[0magv_8\n";
        writeln_whole(&mut log, coloured);
        let long = format!("robot.id=agv_9 {}", "ü".repeat(LOG_LINE_BYTES_MAX));
        writeln_whole(&mut log, &long);
        let lines = of("agv_7");
        assert_eq!(lines.len(), LOG_LINES_OF_ROBOT_MAX);
        assert_eq!(lines[0], "WARN note 2 robot.id=agv_7 late=1");
        assert_eq!(of("agv_8"), ["WARN odd robot.id=agv_8"]);
        assert!(of("agv_9")[0].len() <= LOG_LINE_BYTES_MAX);
        assert_eq!(of("nobody"), [] as [String; 0]);
        assert!(String::from_utf8(written).unwrap().contains("INFO ready"));
        for number in 0..LOG_LINES_ROBOTS_MAX {
            remember(&format!("robot.id=b{number}"));
        }
        assert!(lines().len() <= LOG_LINES_ROBOTS_MAX);
    }

    fn writeln_whole(log: &mut impl Write, line: &str) {
        log.write_all(line.as_bytes()).unwrap();
    }
}
