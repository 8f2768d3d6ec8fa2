//! Output of commands: JSON and text on standard output, trajectories into files.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use fleetcal_estimator::{Pose2, RobotTime};
use serde::Serialize;

use crate::CommandError;

/// Prints a document on standard output.
///
/// # Errors
/// Standard output cannot be written.
pub fn print_json(document: &impl Serialize) -> Result<(), CommandError> {
    let mut json = serde_json::to_string_pretty(document)?;
    json.push('\n');
    print_text(&json)
}

/// Prints text on standard output.
///
/// # Errors
/// Standard output cannot be written.
pub fn print_text(text: &str) -> Result<(), CommandError> {
    let mut stdout = std::io::stdout().lock();
    stdout.write_all(text.as_bytes())?;
    stdout.flush()?;
    Ok(())
}

/// Trajectory file of the TUM tools: `stamp_s x y z qx qy qz qw`, one pose a line.
#[derive(Debug)]
pub struct Trajectory {
    path: PathBuf,
    file: BufWriter<File>,
}

impl Trajectory {
    /// Creates the file, or empties it.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn create(path: &Path) -> Result<Self, CommandError> {
        match File::create(path) {
            Ok(file) => Ok(Self {
                path: path.to_owned(),
                file: BufWriter::new(file),
            }),
            Err(source) => Err(CommandError::Write {
                path: path.to_owned(),
                source,
            }),
        }
    }

    /// Adds a pose in the plane.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn add(&mut self, stamp: RobotTime, pose: &Pose2) -> Result<(), CommandError> {
        let line = tum_line(stamp, pose);
        self.file
            .write_all(line.as_bytes())
            .map_err(|source| self.failed(source))
    }

    /// Writes the buffered rest.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(mut self) -> Result<(), CommandError> {
        self.file.flush().map_err(|source| self.failed(source))
    }

    fn failed(&self, source: std::io::Error) -> CommandError {
        CommandError::Write {
            path: self.path.clone(),
            source,
        }
    }
}

/// Formats a pose as a line. Seconds are written from the integer: a double cannot hold nanoseconds
/// since 1970.
fn tum_line(stamp: RobotTime, pose: &Pose2) -> String {
    let (seconds, ns) = (
        stamp.0.div_euclid(1_000_000_000),
        stamp.0.rem_euclid(1_000_000_000),
    );
    let (qz, qw) = (0.5 * pose.yaw_rad).sin_cos();
    let mut line = format!("{seconds}.{ns:09}");
    for value in [pose.x_m, pose.y_m, 0.0, 0.0, 0.0, qz, qw] {
        // Writing into a string does not fail.
        if write!(line, " {value:.9}").is_err() {
            break;
        }
    }
    line.push('\n');
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_keeps_nanoseconds_and_the_heading() {
        let line = tum_line(
            RobotTime(1_700_000_000_250_000_001),
            &Pose2::new(1.0, -2.0, 0.6),
        );
        assert_eq!(
            line,
            "1700000000.250000001 1.000000000 -2.000000000 0.000000000 0.000000000 0.000000000 \
             0.295520207 0.955336489\n"
        );
    }
}
