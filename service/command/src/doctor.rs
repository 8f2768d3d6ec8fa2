//! `fleetcal doctor`: the joining checks over a recording.

use std::path::PathBuf;

use clap::Args;
use fleetcal_clock::thread_cpu;
use fleetcal_domain::robot::{CheckFinding, CheckedStream, Mount};
use fleetcal_estimator::{LidarOdometry, Pose2};
use fleetcal_fleet::{Intake, JoiningChecks, ReadingSettings, scan_of};
use fleetcal_model::Stream;
use fleetcal_robot::recording::{RecordedMessage, Recording};
use serde::Serialize;
use utoipa::ToSchema;

use crate::CommandError;
use crate::output::{print_json, print_text};
use crate::progress::Progress;
use crate::recording::{RecordedStream, streams};
use crate::robot_arguments::RobotArguments;

/// Arguments of `fleetcal doctor`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The recording: ROS 2 messages in MCAP or in a .db3 of rosbag2, or its folder
    pub recording: PathBuf,
    /// The robot whose recording it is.
    #[command(flatten)]
    pub robot: RobotArguments,
    /// Yaw of the LiDAR by the drawing, in degrees: 180 where it looks backwards
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true, value_parser = yawed)]
    pub nominal_yaw: Option<Mount>,
    /// Print the whole result as one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Results of the checks of a recording.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(crate) struct DoctorReport {
    schema_version: u32,
    /// Name of the robot.
    robot: String,
    /// Way of the LiDAR, m.
    way_m: f64,
    /// CPU time of the checks, without that of reading and LiDAR odometry, s.
    checks_cpu_s: f64,
    /// CPU time of LiDAR odometry, s.
    odometry_cpu_s: f64,
    /// Each stream as it came.
    streams: Vec<CheckedStream>,
    /// Every cause that is named, and an entry for each check that names none.
    findings: Vec<CheckFinding>,
}

impl DoctorReport {
    /// Goes up by one whenever a field is renamed or removed, or means something else. A field that
    /// is added leaves it.
    pub(crate) const SCHEMA_VERSION: u32 = 1;
}

/// Runs the command.
///
/// # Errors
/// One sentence, with the exit status that goes with it; of causes that were named, their number.
pub fn run(arguments: &Arguments) -> Result<(), CommandError> {
    let recording = Recording::open(&arguments.recording)?;
    let mut robot = arguments.robot.of(&recording)?;
    for remark in robot.description.iter().flat_map(|of| &of.remarks) {
        eprintln!("fleetcal: {remark}");
    }
    robot.config.nominal_extrinsics = arguments.nominal_yaw.or(robot.config.nominal_extrinsics);
    let mut run = Run {
        intake: Intake::new(ReadingSettings::of(&robot.config)),
        checks: JoiningChecks::of_recording(&robot.config),
        odometry: LidarOdometry::default(),
        streams: streams(&robot.topics),
        checks_cpu_s: 0.0,
        odometry_cpu_s: 0.0,
    };
    let names = robot.topics.names();
    let mut progress = Progress::over(recording.count(&names));
    for message in recording.messages(&names)? {
        run.take(&message?);
        progress.advance();
    }
    progress.finish();
    let report = run.report(robot.id.to_string());
    if arguments.json {
        print_json(&report)?;
    } else {
        print_text(&in_words(&report))?;
    }
    match report
        .findings
        .iter()
        .filter(|row| row.cause.is_some())
        .count()
    {
        0 => Ok(()),
        causes => Err(CommandError::Found { causes }),
    }
}

/// A recording on its way through the checks.
struct Run {
    intake: Intake,
    checks: JoiningChecks,
    odometry: LidarOdometry,
    streams: Vec<RecordedStream>,
    checks_cpu_s: f64,
    odometry_cpu_s: f64,
}

impl Run {
    fn take(&mut self, message: &RecordedMessage) {
        let mut streams = self.streams.iter_mut();
        let Some(stream) = streams.find(|stream| stream.carries(message)) else {
            return;
        };
        let (of, _) = stream.kind();
        let taken = stream.read(&mut self.intake, message);
        let arrival_ns = i64::try_from(message.log_time_ns).unwrap_or(i64::MAX);
        let began = thread_cpu();
        let sighting = self.intake.sight(&stream.read_message(message));
        self.checks.take(of, arrival_ns, sighting.as_ref(), &taken);
        let checked = thread_cpu();
        let scan = taken.as_ref().ok().and_then(scan_of);
        let pose = scan.and_then(|scan| self.odometry.process(scan));
        let moved = thread_cpu();
        if let Some(pose) = &pose {
            self.checks.take_odometry(pose);
        }
        let ended = thread_cpu();
        self.checks_cpu_s +=
            (checked.saturating_sub(began) + ended.saturating_sub(moved)).as_secs_f64();
        self.odometry_cpu_s += moved.saturating_sub(checked).as_secs_f64();
    }

    fn report(&self, robot: String) -> DoctorReport {
        let topic = |stream: Stream| {
            let of = self.streams.iter().find(|of| of.kind().0 == stream);
            of.map(|of| of.topic().to_owned()).unwrap_or_default()
        };
        let checks = self.checks.report(topic);
        DoctorReport {
            schema_version: DoctorReport::SCHEMA_VERSION,
            robot,
            way_m: checks.way_m,
            checks_cpu_s: self.checks_cpu_s,
            odometry_cpu_s: self.odometry_cpu_s,
            streams: checks.streams,
            findings: checks.findings,
        }
    }
}

/// A mount that is known by its yaw alone.
fn yawed(degrees: &str) -> Result<Mount, String> {
    let yaw_deg: f64 = degrees.parse().map_err(|_| "expected degrees".to_owned())?;
    let pose = Pose2::new(0.0, 0.0, yaw_deg.to_radians());
    Mount::try_from(pose).map_err(|refused| refused.to_string())
}

/// The report as a person reads it: streams, then checks.
fn in_words(report: &DoctorReport) -> String {
    let mut lines = vec![
        format!("{}: {:.1} m", report.robot, report.way_m),
        String::new(),
    ];
    for row in &report.streams {
        lines.push(stream_words(row));
        if let Some(reason) = &row.first_refusal {
            lines.push(format!(
                "{:<16} {} refused, the first: {reason}",
                "", row.refused
            ));
        }
    }
    lines.push(String::new());
    for row in &report.findings {
        let state = row.state.name().replace('_', " ").to_uppercase();
        lines.push(
            format!("{state:<8} {:<10} {}", row.check, row.seen)
                .trim_end()
                .to_owned(),
        );
        if let (Some(advice), Some(after_m), Some(after_s)) =
            (&row.advice, row.after_m, row.after_s)
        {
            lines.push(format!(
                "{:<19} {advice} (seen after {after_m:.0} m, {after_s:.0} s)",
                ""
            ));
        }
    }
    lines.push(String::new());
    lines.join("\n")
}

fn stream_words(row: &CheckedStream) -> String {
    let mut words = vec![
        format!("{:<16} {} messages", row.stream, row.messages),
        format!("{:.1} Hz", row.rate_hz),
    ];
    let age = row
        .age_ms
        .map(|age_ms| format!("stamped {age_ms:.1} ms before arrival"));
    let uneven = row
        .uneven_ms
        .map(|uneven_ms| format!("uneven by {uneven_ms:.1} ms"));
    words.extend(age.into_iter().chain(uneven));
    if row.gaps > 0 {
        words.push(format!(
            "{} gaps of up to {:.1} s",
            row.gaps, row.longest_gap_s
        ));
    }
    let counted = [(row.repeated, "with the stamp before"), (row.late, "late")];
    let counted = counted.into_iter().filter(|(count, _)| *count > 0);
    words.extend(counted.map(|(count, what)| format!("{count} {what}")));
    let frames = row.frames.iter().filter(|name| !name.is_empty());
    words.extend(frames.map(|name| format!("frame {name}")));
    words.join(", ")
}
