//! Latest log lines of each robot, beside the log itself.

use std::collections::{BTreeMap, VecDeque};
use std::io::{self, Write};
use std::sync::{Mutex, MutexGuard, PoisonError};

use fleetcal_limits::{LOG_LINE_BYTES_MAX, LOG_LINES_OF_ROBOT_MAX, LOG_LINES_ROBOTS_MAX};
use fleetcal_model::RobotId;

/// Field by which a line names its robot.
const FIELD: &str = "robot.id=";

/// Lines of this process's log.
static LINES: Mutex<Lines> = Mutex::new(Lines {
    robots: BTreeMap::new(),
    last: 0,
});

/// Latest lines about robots.
#[derive(Debug)]
struct Lines {
    robots: BTreeMap<RobotId, OfRobot>,
    /// Number of the last line.
    last: u64,
}

/// Latest lines about a robot.
#[derive(Debug, Default)]
struct OfRobot {
    /// The lines, the oldest first.
    lines: VecDeque<String>,
    /// Number of the newest one.
    newest: u64,
}

impl Lines {
    /// Remembers a line. For that of a further robot beyond [`LOG_LINES_ROBOTS_MAX`], those of the
    /// robot whose last line is the oldest are dropped.
    fn add(&mut self, robot: RobotId, line: String) {
        if !self.robots.contains_key(&robot) && self.robots.len() >= LOG_LINES_ROBOTS_MAX {
            let oldest = self.robots.iter().min_by_key(|(_, of)| of.newest);
            if let Some(oldest) = oldest.map(|(robot, _)| robot.clone()) {
                self.robots.remove(&oldest);
            }
        }
        self.last += 1;
        let of_robot = self.robots.entry(robot).or_default();
        if of_robot.lines.len() >= LOG_LINES_OF_ROBOT_MAX {
            of_robot.lines.pop_front();
        }
        of_robot.lines.push_back(line);
        of_robot.newest = self.last;
    }
}

/// Returns the latest log lines about a robot, the oldest first.
pub fn lines_of(robot: &RobotId) -> Vec<String> {
    let lines = lines();
    let of_robot = lines.robots.get(robot);
    of_robot.map_or_else(Vec::new, |of| of.lines.iter().cloned().collect())
}

/// Locks the lines. They are whole after every statement, so the panic of another thread is no reason
/// to stop.
fn lines() -> MutexGuard<'static, Lines> {
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
    lines().add(robot, line);
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
        let of_seven = of("agv_7");
        assert_eq!(of_seven.len(), LOG_LINES_OF_ROBOT_MAX);
        assert_eq!(of_seven[0], "WARN note 2 robot.id=agv_7 late=1");
        assert_eq!(of("agv_8"), ["WARN odd robot.id=agv_8"]);
        assert!(of("agv_9")[0].len() <= LOG_LINE_BYTES_MAX);
        assert_eq!(of("nobody"), [] as [String; 0]);
        assert!(String::from_utf8(written).unwrap().contains("INFO ready"));
        // The alphabetically first one is the latest but one: it stays, and the oldest is dropped.
        for number in 0..LOG_LINES_ROBOTS_MAX - 1 {
            remember(&format!("robot.id=b{number}"));
        }
        remember("robot.id=a robot that logs");
        remember("robot.id=c");
        assert_eq!(lines().robots.len(), LOG_LINES_ROBOTS_MAX);
        assert_eq!(of("a"), ["robot.id=a robot that logs"]);
        assert_eq!(of("b0"), [] as [String; 0]);
        assert_eq!(of("b1"), ["robot.id=b1"]);
    }

    fn writeln_whole(log: &mut impl Write, line: &str) {
        log.write_all(line.as_bytes()).unwrap();
    }
}
