//! `fleetcal calibrate`: the service's estimator over a recording.

use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;

use clap::Args;
use fleetcal_clock::{Clock, thread_cpu};
use fleetcal_domain::robot::RobotConfig;
use fleetcal_estimator::lidar_odometry::BeamTimes;
use fleetcal_estimator::{Calibrator, Effect, EstimatorSettings, Event};
use fleetcal_fleet::{Intake, LatestPose, ReadingSettings, document};
use fleetcal_operations::recording_export::RecordingExport;
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::CalibrationReport;
use fleetcal_robot::recording::{RecordedMessage, Recording, Topics};

use crate::CommandError;
use crate::known_map::KnownMapArguments;
use crate::output::{Trajectory, print_json, print_text};
use crate::progress::Progress;
use crate::recording::{RecordedStream, streams};
use crate::report;
use crate::robot_arguments::RobotArguments;
use crate::session_record::SessionRecord;
use crate::table::table;
use crate::timing::ScanTimes;

/// Arguments of `fleetcal calibrate`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The recording: ROS 2 messages in MCAP or in a .db3 of rosbag2, or its folder
    pub recording: PathBuf,
    /// The robot whose recording it is.
    #[command(flatten)]
    pub robot: RobotArguments,
    /// A known map to localise in.
    #[command(flatten)]
    pub known_map: KnownMapArguments,
    /// Print the whole result as one JSON document
    #[arg(long)]
    pub json: bool,
    /// Write the rear axle's trajectory as a TUM file
    #[arg(long, value_name = "OUT.tum")]
    pub trajectory: Option<PathBuf>,
    /// Write the result with its plots as one self-contained page
    #[arg(long, value_name = "OUT.html")]
    pub report: Option<PathBuf>,
    /// Write the session as MCAP for Foxglove: the streams, the estimates over time, and the events
    #[arg(long, value_name = "OUT.mcap")]
    pub export: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// One sentence, with its exit status.
pub fn run(arguments: &Arguments, clock: &dyn Clock) -> Result<(), CommandError> {
    let recording = Recording::open(&arguments.recording)?;
    spare_recording(&recording, arguments)?;
    let robot = arguments.robot.of(&recording)?;
    let known = (&robot.id, &robot.config, &robot.settings);
    let run = Run::start(&recording, &robot.topics, known, arguments)?;
    let finished = run.finish(clock)?;
    let described = robot.description.iter().flat_map(|of| &of.remarks);
    for remark in described.chain(&finished.remarks) {
        eprintln!("fleetcal: {remark}");
    }
    let mut report = finished.report;
    report.description = robot.description;
    if let (Some(path), Some(session)) = (&arguments.report, &finished.session) {
        report::write(path, &arguments.recording, &report, session, clock.now())?;
    }
    if arguments.json {
        print_json(&report)
    } else {
        print_text(&table(&report))
    }
}

/// Refuses to write a result over the recording.
fn spare_recording(recording: &Recording, arguments: &Arguments) -> Result<(), CommandError> {
    let outputs = [&arguments.export, &arguments.trajectory, &arguments.report];
    let mut outputs = outputs.into_iter().flatten();
    match outputs.find(|output| recording.holds(output)) {
        Some(output) => Err(CommandError::OverRecording(output.clone())),
        None => Ok(()),
    }
}

/// Calibration of one recording in progress.
#[derive(Debug)]
struct Run<'a> {
    recording: &'a Recording,
    topics: &'a Topics,
    calibrator: Calibrator,
    intake: Intake,
    streams: Vec<RecordedStream>,
    robot: &'a RobotId,
    trajectory: Option<Trajectory>,
    export: Option<RecordingExport<BufWriter<File>>>,
    /// Record for the report, if one was requested.
    session: Option<SessionRecord>,
    pose: LatestPose,
    times: ScanTimes,
}

/// Result of a recording.
struct Finished {
    report: CalibrationReport,
    /// Remarks on refusals and on the pairing of the rest.
    remarks: Vec<String>,
    session: Option<SessionRecord>,
}

impl<'a> Run<'a> {
    fn start(
        recording: &'a Recording,
        topics: &'a Topics,
        (robot, config, settings): (&'a RobotId, &RobotConfig, &EstimatorSettings),
        arguments: &Arguments,
    ) -> Result<Self, CommandError> {
        let trajectory = arguments
            .trajectory
            .as_deref()
            .map(Trajectory::create)
            .transpose()?;
        let export = arguments.export.as_deref();
        let export = export.map(|path| RecordingExport::create(path, robot));
        Ok(Self {
            recording,
            topics,
            calibrator: Calibrator::new(config.calibrator_config(settings))
                .with_lidar_odometry(arguments.known_map.lidar_odometry()?),
            intake: Intake::new(ReadingSettings::of(config)),
            streams: streams(topics),
            robot,
            trajectory,
            export: export.transpose()?,
            session: arguments.report.is_some().then(SessionRecord::default),
            pose: LatestPose::default(),
            times: ScanTimes::default(),
        })
    }

    /// Processes the recording.
    fn finish(mut self, clock: &dyn Clock) -> Result<Finished, CommandError> {
        let began = clock.elapsed();
        let names = self.topics.names();
        let mut progress = Progress::over(self.recording.count(&names));
        for message in self.recording.messages(&names)? {
            self.take(&message?)?;
            progress.advance();
        }
        let before = thread_cpu();
        let effects = self.calibrator.step(Event::EndOfSession);
        self.times.add(thread_cpu().saturating_sub(before));
        self.follow(&effects)?;
        progress.finish();
        for stream in &self.streams {
            stream.check_usable(self.recording.path())?;
        }
        let wall = clock.elapsed().saturating_sub(began);
        if let Some(trajectory) = self.trajectory.take() {
            trajectory.finish()?;
        }
        if let Some(export) = self.export.take() {
            export.finish_on_disk()?;
        }
        let remarks = self.remarks();
        let timing = self.times.timing(self.calibrator.duration_s(), wall);
        Ok(Finished {
            report: document::report(self.robot, &self.calibrator, timing),
            remarks,
            session: self.session,
        })
    }

    /// Feeds one message to the estimator, as the service does.
    fn take(&mut self, message: &RecordedMessage) -> Result<(), CommandError> {
        let mut streams = self.streams.iter_mut();
        let Some(stream) = streams.find(|stream| stream.carries(message)) else {
            return Ok(());
        };
        let before = thread_cpu();
        let taken = stream.take(&mut self.intake, message);
        let stamp = taken.as_ref().map(|taken| taken.stamp);
        let events = taken.into_iter().flat_map(|taken| taken.events);
        let mut effects = Vec::new();
        for decoded in events {
            effects.extend(self.calibrator.step(decoded.event));
        }
        let spent = thread_cpu().saturating_sub(before);
        if stream.is_wheel_odometry() {
            self.times.add(spent);
        } else {
            self.times.add_scan(spent);
        }
        if let (Some(export), Some(topic)) = (&mut self.export, stream.recording_topic())
            && let Some(stamp) = stamp
        {
            export.message(stamp, &topic, &message.payload)?;
        }
        self.follow(&effects)
    }

    /// Records the effects of a step, and a new pose of the rear axle.
    fn follow(&mut self, effects: &[Effect]) -> Result<(), CommandError> {
        if let Some(session) = &mut self.session {
            session.take(self.robot, effects);
        }
        self.export(effects)?;
        let Some((stamp, pose)) = self.pose.advance(&self.calibrator) else {
            return Ok(());
        };
        if let Some(session) = &mut self.session {
            session.path.push((stamp, pose));
        }
        if let Some(export) = &mut self.export {
            export.pose(stamp, &pose)?;
        }
        match &mut self.trajectory {
            Some(trajectory) => trajectory.add(stamp, &pose),
            None => Ok(()),
        }
    }

    fn export(&mut self, effects: &[Effect]) -> Result<(), CommandError> {
        let Some(export) = &mut self.export else {
            return Ok(());
        };
        for effect in effects {
            match effect {
                Effect::Estimate(estimate) => {
                    export.estimate(&document::estimate_document(self.robot, estimate))?;
                }
                Effect::Change(change) | Effect::ChangeSized(change) => {
                    export.change(&document::change_document(change))?;
                }
                Effect::Dropped(_) | Effect::LidarMoved(_) | Effect::SessionStarted(_) => {}
            }
        }
        Ok(())
    }

    /// Returns remarks about the recording beside its result.
    fn remarks(&self) -> Vec<String> {
        let refusals = self.streams.iter().filter_map(RecordedStream::refusals);
        let mut remarks: Vec<String> = refusals.collect();
        if let Some(pairing) = self.intake.pairing() {
            remarks.push(format!(
                "{} speeds paired with steering angles {:.1} ms from them on average, {:.1} ms at \
                 most; {} without an angle near enough",
                pairing.paired,
                pairing.error_mean_s * 1e3,
                pairing.error_max_s * 1e3,
                pairing.unpaired
            ));
        }
        let estimate = document::estimate_document(self.robot, &self.calibrator.estimate());
        if self.intake.looks_commanded(Some(&estimate)) {
            remarks.push(
                "the steering angle looks commanded instead of measured: it has neither noise nor \
                 an encoder's steps nor a lag"
                    .to_owned(),
            );
        }
        remarks.extend(input_remarks(&self.intake));
        for stream in self.intake.coarsely_stamped() {
            remarks.push(format!(
                "most messages of {} have the stamp of the one before, as where stamps are whole \
                 seconds: of each stamp only the first message is used; stamp each message when it \
                 was measured, to a millisecond or better",
                stream.name()
            ));
        }
        let scanner = self.calibrator.scanner();
        if let Some(floor) = scanner.floor {
            remarks.push(format!(
                "the LiDAR sees the floor {:.1} m away, at {} degrees in its frame: its scanning \
                 plane is probably tilted; these returns are left out",
                floor.distance_m(),
                floor.direction_rad().to_degrees().round() as i64
            ));
        }
        match scanner.beam_times {
            BeamTimes::Turning { duration_s, .. } => remarks.push(format!(
                "the scans have time_increment 0, but the scanner turns: a scan takes {:.1} ms by \
                 its motion; set time_increment in the scanner's driver",
                duration_s * 1e3
            )),
            BeamTimes::Missing => remarks.push(
                "the points of the clouds have no times: no field t, time, timestamp, time_stamp or \
                 offset_time, or all the same; the time offset stays unknown and the LiDAR's pose \
                 can be off; have the driver send the times, or set ignore_times in point_cloud for \
                 clouds that were taken at once or deskewed"
                    .to_owned(),
            ),
            BeamTimes::Stated | BeamTimes::Unknown | BeamTimes::AtOnce => {}
        }
        remarks
    }
}

/// Returns remarks on inputs that are taken for want of better ones.
fn input_remarks(intake: &Intake) -> Vec<String> {
    let mut remarks = Vec::new();
    if intake.steers_by_turn() {
        remarks.push(
            "the steering angle is computed from speed and yaw rate by the wheelbase: its offset \
             is that of the sensor only if the robot computes the yaw rate from its steering by \
             the same wheelbase, not from a gyroscope"
                .to_owned(),
        );
    }
    for stream in intake.unstamped() {
        remarks.push(format!(
            "messages of {} have no stamp: they count as measured when they were recorded, so that \
             every delay on their way is an error of their time",
            stream.name()
        ));
    }
    remarks
}
