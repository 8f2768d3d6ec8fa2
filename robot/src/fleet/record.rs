//! A recording of one simulated robot, with the truth beside it.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationValues;
use fleetcal_proto::ros::PoseStamped;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::message::{StampRefused, drive_message, scan_message, truth_message};
use super::robots::SimulatedRobot;
use crate::recording::{RecordingError, RecordingWriter};
use crate::simulator::{
    Delivered, Imperfections, SettingRefused, SimulatedMessage, Simulation, TrueParameters,
    VehicleModel, WrongInput, WrongInputs,
};

/// Longest recording, s: a day.
pub const RECORD_DURATION_MAX_S: f64 = 86_400.0;

/// Reason for which a recording was not made.
#[derive(Debug, Error)]
pub enum RecordError {
    /// The duration is not that of a recording.
    #[error("duration: got {0} s, expected more than 0 and at most {RECORD_DURATION_MAX_S} s")]
    Duration(f64),
    /// The robot's configuration cannot be simulated.
    #[error(transparent)]
    Setting(#[from] SettingRefused),
    /// The simulated time left the range of ROS stamps.
    #[error(transparent)]
    RobotTime(#[from] StampRefused),
    /// The recording could not be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The truth file beside it could not be written.
    #[error("{}: {source}", path.display())]
    Truth {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        #[source]
        source: io::Error,
    },
}

/// Content of `OUT.truth.json`, with the names of `fleetcal calibrate --json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordedTruth {
    /// The robot.
    pub robot: RobotId,
    /// The vehicle as an operator would register it.
    pub vehicle: RecordedVehicle,
    /// Length of the recording, s.
    pub duration_s: f64,
    /// Message time of its start, from which seconds count, ns since 1970.
    pub start_stamp_ns: i64,
    /// The true values at its end.
    pub parameters: CalibrationValues,
    /// The true values from each change to the next.
    pub segments: Vec<TrueSegment>,
    /// Imperfections that the model of a robot does not cover; left out if there are none.
    #[serde(default, skip_serializing_if = "Imperfections::is_none")]
    pub imperfections: Imperfections,
    /// Names of the wrong inputs in the messages; left out when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub wrong: Vec<String>,
}

/// A vehicle as it is registered.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RecordedVehicle {
    /// Steering geometry.
    pub model: VehicleModel,
    /// Distance between the axles, m.
    pub wheelbase_m: f64,
}

/// The true values over a stretch.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TrueSegment {
    /// Start of the stretch, s from the start of the recording.
    pub from_s: f64,
    /// End of the stretch, s from the start of the recording.
    pub to_s: f64,
    /// The values at the stretch's end.
    pub parameters: CalibrationValues,
}

/// Returns the path of a recording's truth: `OUT.truth.json` beside `OUT.mcap`.
pub fn truth_path(recording: &Path) -> PathBuf {
    recording.with_extension("truth.json")
}

/// Records `duration_s` of a simulated robot: drive, scan and the true pose of `base` at each
/// scan's middle into `path`, the true values into the file that [`truth_path`] names. The same
/// robot gives the same bytes.
///
/// # Errors
/// The duration or the robot's configuration is impossible, or a file cannot be written.
pub fn record(
    robot: &SimulatedRobot,
    duration_s: f64,
    path: &Path,
) -> Result<RecordedTruth, RecordError> {
    record_wrong(robot, duration_s, path, &[])
}

/// Records the same with wrong inputs: the robot is right, its recording is not. Messages are
/// logged when they arrive.
///
/// # Errors
/// Returns an error when the duration or the robot's configuration is impossible, or a file cannot
/// be written.
pub fn record_wrong(
    robot: &SimulatedRobot,
    duration_s: f64,
    path: &Path,
    inputs: &[WrongInput],
) -> Result<RecordedTruth, RecordError> {
    if !(duration_s > 0.0 && duration_s <= RECORD_DURATION_MAX_S) {
        return Err(RecordError::Duration(duration_s));
    }
    let (mut model, mut wheelbase_m) = (robot.model(), robot.wheelbase_m());
    let mut config = robot.config.clone();
    for input in inputs {
        input.configure(&mut config);
        (model, wheelbase_m) = input.described(model, wheelbase_m);
    }
    let mut wrong = WrongInputs::new(inputs, &config)?;
    let mut simulation = Simulation::new(config)?;
    let mut writer = RecordingWriter::create(path, &robot.id)?;
    let start_ns = robot.config.start_stamp_ns;
    let end_ns = start_ns + (duration_s * 1e9) as i64;
    let mut segments = Vec::new();
    let mut changes_s: Vec<f64> = robot
        .config
        .changes
        .iter()
        .map(|change| change.at_s)
        .collect();
    changes_s.retain(|at_s| *at_s > 0.0 && *at_s < duration_s);
    changes_s.sort_by(f64::total_cmp);
    changes_s.dedup();
    changes_s.reverse();
    let mut segment_from_s = 0.0;
    let mut parameters = values(&simulation.parameters());
    loop {
        let emitted = simulation.advance();
        let now_ns = simulation.stamp_ns();
        if let Some(change_s) = changes_s.pop_if(|at_s| (*at_s * 1e9) as i64 + start_ns < now_ns) {
            segments.push(TrueSegment {
                from_s: segment_from_s,
                to_s: change_s,
                parameters,
            });
            segment_from_s = change_s;
        }
        if emitted.sent_ns > end_ns {
            break;
        }
        parameters = values(&simulation.parameters());
        let truth = truth_message(&emitted.truth)?;
        for delivered in wrong.deliver(emitted) {
            write(&mut writer, delivered, &truth, inputs.is_empty())?;
        }
    }
    segments.push(TrueSegment {
        from_s: segment_from_s,
        to_s: duration_s,
        parameters,
    });
    writer.true_values(texts(&parameters))?;
    writer.finish()?;
    let truth = RecordedTruth {
        robot: robot.id.clone(),
        vehicle: RecordedVehicle { model, wheelbase_m },
        duration_s,
        start_stamp_ns: start_ns,
        parameters,
        segments,
        imperfections: robot.config.imperfections,
        wrong: inputs.iter().map(|input| input.name().to_owned()).collect(),
    };
    write_truth(&truth_path(path), &truth)?;
    Ok(truth)
}

fn write(
    writer: &mut RecordingWriter,
    delivered: Delivered,
    truth: &PoseStamped,
    is_right: bool,
) -> Result<(), RecordError> {
    let arrival_ns = delivered.arrival_ns;
    match delivered.message {
        SimulatedMessage::WheelOdometry(drive) if is_right => {
            writer.wheel_odometry(&drive_message(&drive)?)?;
        }
        SimulatedMessage::WheelOdometry(drive) => {
            writer.wheel_odometry_at(&drive_message(&drive)?, arrival_ns)?;
        }
        SimulatedMessage::Scan(scan) => {
            let mut message = scan_message(scan)?;
            delivered.frame.clone_into(&mut message.header.frame_id);
            if is_right {
                writer.scan(&message)?;
            } else {
                writer.scan_at(&message, arrival_ns)?;
            }
            writer.truth(truth)?;
        }
        // A recorder of the robot's own streams: no one publishes these two as ROS messages.
        SimulatedMessage::LidarPose(_) | SimulatedMessage::CrossTrackError(_) => {}
    }
    Ok(())
}

fn write_truth(path: &Path, truth: &RecordedTruth) -> Result<(), RecordError> {
    let failed = |source| RecordError::Truth {
        path: path.to_owned(),
        source,
    };
    let mut file = File::create(path).map_err(failed)?;
    serde_json::to_writer_pretty(&mut file, truth).map_err(|error| failed(error.into()))?;
    file.sync_all().map_err(failed)
}

fn values(parameters: &TrueParameters) -> CalibrationValues {
    CalibrationValues {
        steering_offset_rad: parameters.steering_offset_rad,
        lidar_x_m: parameters.lidar_in_base.x_m,
        lidar_y_m: parameters.lidar_in_base.y_m,
        lidar_yaw_rad: parameters.lidar_in_base.yaw_rad,
        speed_scale: Some(parameters.speed_scale),
        wheelbase_m: Some(parameters.wheelbase_m),
        steering_gain: Some(parameters.steering_gain),
        time_offset_s: Some(parameters.time_offset_s),
    }
}

/// Returns the values by name, for the recording's own metadata.
fn texts(values: &CalibrationValues) -> BTreeMap<String, String> {
    let optional = [
        ("speed_scale", values.speed_scale),
        ("wheelbase_m", values.wheelbase_m),
        ("steering_gain", values.steering_gain),
        ("time_offset_s", values.time_offset_s),
    ];
    let always = [
        ("steering_offset_rad", values.steering_offset_rad),
        ("lidar_x_m", values.lidar_x_m),
        ("lidar_y_m", values.lidar_y_m),
        ("lidar_yaw_rad", values.lidar_yaw_rad),
    ];
    let optional = optional
        .into_iter()
        .filter_map(|(name, value)| Some((name, value?)));
    let named = always.into_iter().chain(optional);
    named
        .map(|(name, value)| (name.to_owned(), value.to_string()))
        .collect()
}

#[cfg(test)]
mod tests {
    use fleetcal_proto::RosMessage;
    use fleetcal_proto::ros::LaserScan;

    use super::super::robots::simulated_robots;
    use super::*;
    use crate::recording::Recording;
    use crate::simulator::{Change, ScheduledChange};

    fn robot() -> SimulatedRobot {
        let mut robot = simulated_robots(1, 3).unwrap().remove(0);
        robot.config.start_stamp_ns = 1_760_000_000_000_000_000;
        robot
    }

    #[test]
    fn a_recording_reads_back_with_its_truth_and_is_the_same_each_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("one.mcap");
        let mut robot = robot();
        let change = Change::SteeringOffset(0.03);
        robot.config.changes = vec![ScheduledChange { at_s: 2.0, change }];
        let truth = record(&robot, 5.0, &path).unwrap();

        let recording = Recording::open(&path).unwrap();
        let topics = [
            "/tugger_01/wheel_odometry",
            "/tugger_01/scan",
            "/tugger_01/truth",
        ];
        let counts = topics.map(|topic| recording.count(&[topic]));
        assert_eq!(counts, [500, 49, 49]);
        let payloads = |topic: &str| -> Vec<Vec<u8>> {
            recording
                .messages(&[topic])
                .unwrap()
                .map(|message| message.unwrap().payload)
                .collect()
        };
        let scan = LaserScan::from_cdr(&payloads(topics[1])[20]).unwrap();
        let pose = PoseStamped::from_cdr(&payloads(topics[2])[20]).unwrap();
        let middle_ns = pose.header.stamp.as_ns() - scan.header.stamp.as_ns();
        assert!((middle_ns - 49_951_172).abs() <= 1, "{middle_ns}");

        let text = std::fs::read(truth_path(&path)).unwrap();
        assert_eq!(
            serde_json::from_slice::<RecordedTruth>(&text).unwrap(),
            truth
        );
        let [before, after] = truth.segments.as_slice() else {
            panic!("two stretches: {:?}", truth.segments);
        };
        assert!((before.to_s - 2.0).abs() < 1e-9 && (after.from_s - 2.0).abs() < 1e-9);
        let jump_rad = after.parameters.steering_offset_rad - before.parameters.steering_offset_rad;
        assert!((jump_rad - 0.03).abs() < 1e-12);
        assert_eq!(truth.parameters, after.parameters);

        let again = folder.path().join("two.mcap");
        record(&robot, 5.0, &again).unwrap();
        assert!(std::fs::read(&path).unwrap() == std::fs::read(&again).unwrap());
    }

    #[test]
    fn the_truth_names_imperfections_and_the_wheelbase_that_is_registered() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("imperfect.mcap");
        let mut robot = robot();
        robot.config.imperfections.vehicle.wheelbase = 0.02;
        robot.config.imperfections.clocks.drive_drift = 1e-4;
        let truth = record(&robot, 3.0, &path).unwrap();
        assert!((truth.vehicle.wheelbase_m - 1.224).abs() < 1e-12);
        assert!((truth.parameters.wheelbase_m.unwrap() - 1.2).abs() < 1e-12);
        let text = std::fs::read(truth_path(&path)).unwrap();
        let document: serde_json::Value = serde_json::from_slice(&text).unwrap();
        assert_eq!(document["imperfections"]["vehicle"]["wheelbase"], 0.02);
        assert_eq!(document["imperfections"]["clocks"]["drive_drift"], 1e-4);
        assert_eq!(
            serde_json::from_slice::<RecordedTruth>(&text).unwrap(),
            truth
        );
        let plain = folder.path().join("plain.mcap");
        record(&self::robot(), 3.0, &plain).unwrap();
        let text = std::fs::read_to_string(truth_path(&plain)).unwrap();
        assert!(!text.contains("imperfections"), "{text}");
    }

    #[test]
    fn what_cannot_be_recorded_is_refused_in_one_sentence() {
        let folder = tempfile::tempdir().unwrap();
        let error = |duration_s: f64, file: &str| {
            record(&robot(), duration_s, &folder.path().join(file))
                .unwrap_err()
                .to_string()
        };
        assert!(error(-1.0, "a.mcap").starts_with("duration: got -1 s"));
        assert!(error(f64::NAN, "a.mcap").starts_with("duration: got NaN s"));
        assert!(error(1.0, "missing/a.mcap").contains("missing/a.mcap"));
    }
}
