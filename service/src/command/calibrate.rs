//! `fleetcal calibrate`: the service's estimator over a recording.

use std::path::{Path, PathBuf};

use clap::Args;
use fleetcal_estimator::{Calibrator, Effect, EstimatorSettings, Event, Stamp, VehicleModel};
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::CalibrationReport;
use fleetcal_robot::recording::{ChosenPose, Recording, Topics, choose_topics};

use crate::clock::{Clock, thread_cpu};
use crate::command::export::Export;
use crate::command::height_band::HeightBand;
use crate::command::known_map::KnownMapArguments;
use crate::command::output::{Trajectory, print_json, print_text};
use crate::command::progress::Progress;
use crate::command::recording::RecordedStream;
use crate::command::report;
use crate::command::session_record::SessionRecord;
use crate::command::table::table;
use crate::command::timing::ScanTimes;
use crate::command::{CommandError, ModelName};
use crate::config::{Config, RobotConfig, Wheelbase};
use crate::fleet::{Stream, document};

/// The robot's name when neither the caller nor the recording has one.
const UNNAMED: &str = "robot";

/// What `fleetcal calibrate` takes.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The recording: ROS 2 messages in MCAP or in a .db3 of rosbag2, or its folder
    pub recording: PathBuf,
    /// Distance between the axles, in metres
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub wheelbase: Option<f64>,
    /// How the vehicle steers [default: bicycle, or what --config says]
    #[arg(long)]
    pub model: Option<ModelName>,
    /// The robot's name [default: the first chunk of the drive topic]
    #[arg(long, value_name = "NAME")]
    pub robot: Option<String>,
    /// The topic with `AckermannDriveStamped` messages, if there are several
    #[arg(long, value_name = "TOPIC")]
    pub drive_topic: Option<String>,
    /// The topic with `LaserScan` or `PointCloud2` messages, if there are several
    #[arg(long, value_name = "TOPIC")]
    pub scan_topic: Option<String>,
    /// A topic with `Odometry` messages of the LiDAR, instead of its scans
    #[arg(long, value_name = "TOPIC")]
    pub pose_topic: Option<String>,
    /// A `fleetcal.toml`, for the estimator's settings and the robot's vehicle
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Of clouds, the heights to take in the LiDAR's frame [default: -0.5,0.5, or what --config says]
    #[arg(long, value_name = "MIN_M,MAX_M", allow_hyphen_values = true)]
    pub height_band: Option<HeightBand>,
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
    /// Write the session as MCAP for Foxglove: the streams, what was known when, and what happened
    #[arg(long, value_name = "OUT.mcap")]
    pub export: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// One sentence, with the exit status that goes with it.
pub fn run(arguments: &Arguments, clock: &dyn Clock) -> Result<(), CommandError> {
    let recording = Recording::open(&arguments.recording)?;
    spare_recording(&recording, arguments)?;
    let topics = choose_topics(
        recording.channels(),
        arguments.drive_topic.as_deref(),
        arguments.scan_topic.as_deref(),
        arguments.pose_topic.as_deref(),
    )?;
    let name = arguments
        .robot
        .as_deref()
        .or_else(|| topics.robot())
        .unwrap_or(UNNAMED);
    let robot = RobotId::parse(name)?;
    let file = arguments
        .config
        .as_deref()
        .map(Config::read)
        .transpose()?
        .unwrap_or_default();
    let config = vehicle_of(arguments, &robot, &file)?;
    let known = (&robot, &config, &file.estimator);
    let run = Run::start(&recording, &topics, known, arguments)?;
    let finished = run.finish(clock)?;
    for refusal in finished.refusals {
        eprintln!("fleetcal: {refusal}");
    }
    let report = finished.report;
    if let Some(path) = &arguments.report {
        report::write(path, &arguments.recording, &report, &finished.session)?;
    }
    if arguments.json {
        print_json(&report)
    } else {
        print_text(&table(&report))
    }
}

/// No result is written over what it is calculated from.
fn spare_recording(recording: &Recording, arguments: &Arguments) -> Result<(), CommandError> {
    let outputs = [&arguments.export, &arguments.trajectory, &arguments.report];
    let originals = [recording.path(), recording.file()];
    let is_original = |there: &PathBuf| {
        let mut originals = originals.iter().filter_map(|path| path.canonicalize().ok());
        originals.any(|original| original == *there)
    };
    for output in outputs.into_iter().flatten() {
        if output.canonicalize().is_ok_and(|there| is_original(&there)) {
            return Err(CommandError::OverRecording(output.clone()));
        }
    }
    Ok(())
}

/// The vehicle: the flags first, then the robot's entry in the file.
fn vehicle_of(
    arguments: &Arguments,
    robot: &RobotId,
    file: &Config,
) -> Result<RobotConfig, CommandError> {
    let entry = file
        .robots
        .iter()
        .find(|entry| entry.id == *robot)
        .map(|entry| &entry.config);
    let given = arguments.wheelbase.map(Wheelbase::try_from).transpose()?;
    let wheelbase = given
        .or_else(|| entry.map(|config| config.wheelbase_m))
        .ok_or_else(|| CommandError::WheelbaseMissing {
            robot: robot.to_string(),
        })?;
    let model = arguments.model.map(VehicleModel::from);
    let mut config = entry.cloned().unwrap_or_else(|| {
        RobotConfig::of_vehicle(model.unwrap_or(VehicleModel::Bicycle), wheelbase)
    });
    config.wheelbase_m = wheelbase;
    if let Some(model) = model {
        config.model = model;
    }
    Ok(config)
}

/// One recording on its way through the estimator.
#[derive(Debug)]
struct Run<'a> {
    recording: &'a Recording,
    topics: &'a Topics,
    calibrator: Calibrator,
    drive: RecordedStream,
    pose: RecordedStream,
    robot: &'a RobotId,
    trajectory: Option<Trajectory>,
    export: Option<Export>,
    session: SessionRecord,
    last_pose: Option<Stamp>,
    times: ScanTimes,
}

/// What a recording came to.
struct Finished {
    report: CalibrationReport,
    /// What was refused, in words.
    refusals: Vec<String>,
    session: SessionRecord,
}

impl<'a> Run<'a> {
    fn start(
        recording: &'a Recording,
        topics: &'a Topics,
        (robot, config, settings): (&'a RobotId, &RobotConfig, &EstimatorSettings),
        arguments: &Arguments,
    ) -> Result<Self, CommandError> {
        let pose_stream = match topics.pose {
            ChosenPose::Scan(_) => Stream::Scan,
            ChosenPose::LidarOdometry(_) => Stream::LidarOdometry,
        };
        let trajectory = arguments
            .trajectory
            .as_deref()
            .map(Trajectory::create)
            .transpose()?;
        let export = arguments.export.as_deref();
        let export = export.map(|path| Export::create(path, robot, topics));
        let configured = config.point_cloud.unwrap_or_default();
        let band = HeightBand::or_of(arguments.height_band, configured);
        Ok(Self {
            recording,
            topics,
            calibrator: Calibrator::new(config.calibrator_config(settings))
                .with_lidar_odometry(arguments.known_map.lidar_odometry()?),
            drive: RecordedStream::of(&topics.drive, Stream::Drive, band),
            pose: RecordedStream::of(topics.pose.channel(), pose_stream, band),
            robot,
            trajectory,
            export: export.transpose()?,
            session: SessionRecord::default(),
            last_pose: None,
            times: ScanTimes::default(),
        })
    }

    /// Works through the recording.
    fn finish(mut self, clock: &dyn Clock) -> Result<Finished, CommandError> {
        let began = clock.elapsed();
        let names = self.topics.names();
        let mut progress = Progress::over(self.recording.count(&names));
        for message in self.recording.messages(&names)? {
            let message = message?;
            let is_drive = self.drive.carries(&message);
            let before = thread_cpu();
            let stream = if is_drive {
                &mut self.drive
            } else {
                &mut self.pose
            };
            let decoded = stream.decode(&message);
            let effects = decoded.map(|decoded| self.calibrator.step(decoded.event));
            let spent = thread_cpu().saturating_sub(before);
            if is_drive {
                self.times.add(spent);
            } else {
                self.times.add_scan(spent);
            }
            if let Some(export) = &mut self.export {
                export.message(&message)?;
            }
            self.follow(&effects.unwrap_or_default())?;
            progress.advance();
        }
        let before = thread_cpu();
        let effects = self.calibrator.step(Event::EndOfSession);
        self.times.add(thread_cpu().saturating_sub(before));
        self.follow(&effects)?;
        progress.finish();
        self.check_usable(self.recording.path())?;
        let wall = clock.elapsed().saturating_sub(began);
        if let Some(trajectory) = self.trajectory.take() {
            trajectory.finish()?;
        }
        if let Some(export) = self.export.take() {
            export.finish()?;
        }
        let timing = self.times.timing(self.calibrator.duration_s(), wall);
        let refusals = [self.drive.refusals(), self.pose.refusals()];
        Ok(Finished {
            report: document::report(self.robot, &self.calibrator, timing),
            refusals: refusals.into_iter().flatten().collect(),
            session: self.session,
        })
    }

    /// Writes down what a step said, and the rear axle's pose when it is a new one.
    fn follow(&mut self, effects: &[Effect]) -> Result<(), CommandError> {
        self.session.take(self.robot, effects);
        if let Some(export) = &mut self.export {
            export.effects(effects)?;
        }
        let Some((stamp, pose)) = self.calibrator.base_pose() else {
            return Ok(());
        };
        if self.last_pose == Some(stamp) {
            return Ok(());
        }
        self.last_pose = Some(stamp);
        self.session.path.push((stamp, pose));
        if let Some(export) = &mut self.export {
            export.pose(stamp, &pose)?;
        }
        match &mut self.trajectory {
            Some(trajectory) => trajectory.add(stamp, &pose),
            None => Ok(()),
        }
    }

    fn check_usable(&self, path: &Path) -> Result<(), CommandError> {
        self.drive.check_usable(path)?;
        self.pose.check_usable(path)
    }
}
