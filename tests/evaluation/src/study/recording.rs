//! Study 6f: a real tricycle's recording beside published fits.

use std::path::PathBuf;
use std::process::Command;

use serde::Deserialize;

use crate::error::EvaluationError;
use crate::report::{Section, Table};

const RECORDING: &str = "sapienza_tricycle.mcap";
/// Published fit that gave the recording's wheelbase: steering offset and yaw in degrees, x and y
/// in m.
const PUBLISHED: [f64; 4] = [1.810, -0.023, -0.115, 3.203];
/// Another published fit, with its lengths (it assumes an 11 % smaller wheel) converted to the same
/// wheel.
const PUBLISHED_TOO: [f64; 4] = [1.785, 0.004, 0.94, 2.90];
/// A robust batch fit of all eight parameters over the same recording.
const BATCH: [f64; 4] = [1.799, -0.016, -0.5, 3.7];
/// Credible distances from the first one: 3 cm, 4 cm, 1°, 1°.
const CREDIBLE: [f64; 4] = [0.03, 0.04, 1.0, 1.0];

/// Paths of recordings and the command.
#[derive(Debug, Clone, Default)]
pub struct Source {
    /// Folder of the recordings, `FLEETCAL_DATA`.
    pub recordings: Option<PathBuf>,
    /// The command, `FLEETCAL_BIN`.
    pub fleetcal: Option<PathBuf>,
}

#[derive(Debug, Deserialize)]
struct Document {
    duration_s: f64,
    distance_m: f64,
    parameters: Parameters,
}

#[derive(Debug, Deserialize)]
struct Parameters {
    lidar_x: Found,
    lidar_y: Found,
    lidar_yaw: Found,
    steering_offset: Found,
}

#[derive(Debug, Deserialize)]
struct Found {
    value: f64,
    sigma: f64,
    status: String,
}

/// Runs the study, or reports why it did not run.
///
/// # Errors
/// When the command fails on the recording.
pub fn study(source: &Source) -> Result<Section, EvaluationError> {
    let mut section = Section::new("6f. A real tricycle");
    let (Some(recordings), Some(fleetcal)) = (&source.recordings, &source.fleetcal) else {
        section.words(format!(
            "**Not run**: it needs the folder of `{RECORDING}` in `FLEETCAL_DATA` and the command in \
             `FLEETCAL_BIN`; `make evaluation` sets the second."
        ));
        return Ok(section);
    };
    let failed = |why: String| EvaluationError::Recording {
        recording: RECORDING.to_owned(),
        why,
    };
    let output = Command::new(fleetcal)
        .arg("calibrate")
        .arg(recordings.join(RECORDING))
        .args(["--model", "tricycle", "--wheelbase", "1.54757", "--json"])
        .output()
        .map_err(|error| failed(error.to_string()))?;
    if !output.status.success() {
        return Err(failed(String::from_utf8_lossy(&output.stderr).into_owned()));
    }
    let document: Document =
        serde_json::from_slice(&output.stdout).map_err(|error| failed(error.to_string()))?;
    section.words(format!(
        "An AGV with one steered and driven front wheel, {:.0} s and {:.0} m in both directions, with \
         its LiDAR's own odometry (public data of a robotics course at Sapienza, Rome). Nobody knows \
         its truth. Two published fits differ by 1.1° of yaw and 2.7 cm of y; formal sigmas are 4 to \
         5 times too small on it, as its two halves differ by 0.9° of steering.",
        document.duration_s, document.distance_m
    ));
    show(&mut section, &document.parameters);
    Ok(section)
}

fn show(section: &mut Section, parameters: &Parameters) {
    let Parameters {
        lidar_x,
        lidar_y,
        lidar_yaw,
        steering_offset,
    } = parameters;
    let found = [lidar_x, lidar_y, lidar_yaw, steering_offset];
    let unit = [
        1.0,
        1.0,
        180.0 / std::f64::consts::PI,
        180.0 / std::f64::consts::PI,
    ];
    let mut table = Table::new(&["", "x, m", "y, m", "yaw, °", "steering, °"]);
    let mut row = |name: &str, cell: &dyn Fn(usize) -> String| {
        let cells = std::iter::once(name.to_owned()).chain((0..4).map(cell));
        table.row(cells.collect::<Vec<_>>());
    };
    for (name, fit) in [
        ("*published fit*", PUBLISHED),
        ("*another published fit, at the same wheel*", PUBLISHED_TOO),
        ("robust batch fit of eight parameters", BATCH),
    ] {
        row(name, &|i| format!("{:.3}", fit[i]));
    }
    row("**fleetcal, online**", &|i| {
        format!("{:.3}", unit[i] * found[i].value)
    });
    row("claimed sigma", &|i| {
        format!("{:.3}", unit[i] * found[i].sigma)
    });
    row("status", &|i| found[i].status.clone());
    section.table(table);
    for (i, what) in ["x", "y", "yaw", "steering"].into_iter().enumerate() {
        let off = (unit[i] * found[i].value - PUBLISHED[i]).abs();
        let show = |value: f64| {
            if i < 2 {
                format!("{:.1} mm", 1e3 * value)
            } else {
                format!("{value:.2}°")
            }
        };
        let what = format!("real tricycle, {what} from the published fit");
        section.at_most(&what, off, CREDIBLE[i], show);
    }
}
