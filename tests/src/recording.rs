//! Recordings: those that the environment names, and simulated ones.

use std::env;
use std::path::{Path, PathBuf};

use fleetcal_robot::fleet::{RecordedTruth, record, simulated_robots};
use fleetcal_robot::simulator::SimulationConfig;

/// Returns a recording of the folder that `FLEETCAL_DATA` names. Reports it if the variable is not
/// set.
///
/// # Panics
/// When the folder is named and the recording is not in it.
pub fn named(file: &str) -> Option<PathBuf> {
    let Some(folder) = env::var_os("FLEETCAL_DATA").filter(|folder| !folder.is_empty()) else {
        eprintln!("skipped: FLEETCAL_DATA is not set, and the test needs {file} of it");
        return None;
    };
    let path = Path::new(&folder).join(file);
    assert!(path.is_file(), "{} is not there", path.display());
    Some(path)
}

/// Records `duration_s` of a simulated robot, always the same, as `path`.
///
/// # Panics
/// When it cannot be written.
pub fn simulated(path: &Path, duration_s: f64) -> RecordedTruth {
    simulated_with(path, duration_s, |_| {})
}

/// Records a simulated robot with a changed configuration.
///
/// # Panics
/// When it cannot be recorded.
pub fn simulated_with(
    path: &Path,
    duration_s: f64,
    change: impl FnOnce(&mut SimulationConfig),
) -> RecordedTruth {
    let mut robots = simulated_robots(1, 7).expect("one robot");
    let robot = robots.first_mut().expect("one robot");
    change(&mut robot.config);
    record(robot, duration_s, path).expect("a recording")
}
