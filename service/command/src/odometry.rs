//! `fleetcal odometry`: LiDAR odometry alone over a recording.

use std::path::PathBuf;

use clap::Args;
use fleetcal_clock::{Clock, thread_cpu};
use fleetcal_domain::robot::ScanSettings;
use fleetcal_estimator::lidar_odometry::{OdometryPose, Tracking};
use fleetcal_estimator::point_cloud::PlanarBand;
use fleetcal_estimator::{Event, Pose2};
use fleetcal_fleet::{Intake, ReadingSettings};
use fleetcal_model::Stream;
use fleetcal_robot::recording::{Recording, choose_scan_topic};
use serde::Serialize;

use crate::CommandError;
use crate::height_band::HeightBand;
use crate::known_map::KnownMapArguments;
use crate::output::{Trajectory, print_json, print_text};
use crate::progress::Progress;
use crate::recording::RecordedStream;
use crate::timing::ScanTimes;

/// Arguments of `fleetcal odometry`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The recording: ROS 2 messages in MCAP or in a .db3 of rosbag2, or its folder
    pub recording: PathBuf,
    /// The topic with `LaserScan` or `PointCloud2` messages, if there are several
    #[arg(long, value_name = "TOPIC")]
    pub scan_topic: Option<String>,
    /// Write the LiDAR's trajectory as a TUM file: each scan's reference time and pose
    #[arg(long, value_name = "OUT.tum")]
    pub trajectory: PathBuf,
    /// Heights to use from clouds, in the LiDAR's frame [default: -0.5,0.5]
    #[arg(long, value_name = "MIN_M,MAX_M", allow_hyphen_values = true)]
    pub height_band: Option<HeightBand>,
    /// A known map to localise in.
    #[command(flatten)]
    pub known_map: KnownMapArguments,
    /// Print a summary as one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Summary that `fleetcal odometry --json` prints, beside the trajectory.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
pub(crate) struct OdometrySummary {
    /// [`OdometrySummary::SCHEMA_VERSION`] of the program that printed it.
    schema_version: u32,
    /// Scans that have a pose.
    scans: u64,
    /// Scans that could not be read, or have too few returns for a pose.
    scans_rejected: u64,
    /// Scans in each state of tracking.
    tracking: TrackingCounts,
    /// Times the local map was restarted: poses before and after do not compare.
    map_restarts: u64,
    /// Length of the way, m.
    distance_m: f64,
    /// Time from the first pose to the last, s.
    duration_s: f64,
    /// Median CPU time of one scan, ms.
    scan_median_ms: f64,
    /// The CPU time that 99 of 100 scans stay under, ms.
    scan_p99_ms: f64,
    /// CPU time of it all, s.
    cpu_s: f64,
    /// Seconds of recording processed in one second.
    realtime_factor: f64,
}

/// Scans in each state of tracking.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, utoipa::ToSchema)]
struct TrackingCounts {
    /// Number of scans that fit the map.
    tracking: u64,
    /// Number of scans that fit, but a direction is unconstrained or the fit is poor.
    degraded: u64,
    /// Number of scans that do not fit: the pose is a guess.
    lost: u64,
    /// Number of scans that are the first to fit again after a loss.
    recovered: u64,
}

impl TrackingCounts {
    fn count(&mut self, tracking: Tracking) {
        match tracking {
            Tracking::Tracking => self.tracking += 1,
            Tracking::Degraded => self.degraded += 1,
            Tracking::Lost => self.lost += 1,
            Tracking::Recovered => self.recovered += 1,
        }
    }
}

impl Default for OdometrySummary {
    fn default() -> Self {
        Self {
            schema_version: Self::SCHEMA_VERSION,
            scans: 0,
            scans_rejected: 0,
            tracking: TrackingCounts::default(),
            map_restarts: 0,
            distance_m: 0.0,
            duration_s: 0.0,
            scan_median_ms: 0.0,
            scan_p99_ms: 0.0,
            cpu_s: 0.0,
            realtime_factor: 0.0,
        }
    }
}

impl OdometrySummary {
    /// Goes up by one whenever a field is renamed or removed, or means something else. A field that
    /// is added leaves it.
    pub(crate) const SCHEMA_VERSION: u32 = 1;

    fn add(&mut self, pose: &OdometryPose, first: &mut Option<OdometryPose>, last: Option<&Pose2>) {
        self.scans += 1;
        self.tracking.count(pose.tracking);
        if pose.map_restarted && first.is_some() {
            self.map_restarts += 1;
        } else if let Some(last) = last {
            self.distance_m += last.between(&pose.lidar_in_odom).translation().norm();
        }
        let first = first.get_or_insert_with(|| pose.clone());
        self.duration_s = pose.stamp.seconds_since(first.stamp);
    }
}

/// Runs the command.
///
/// # Errors
/// One sentence, with its exit status.
pub fn run(arguments: &Arguments, clock: &dyn Clock) -> Result<(), CommandError> {
    let recording = Recording::open(&arguments.recording)?;
    let channel = choose_scan_topic(recording.channels(), arguments.scan_topic.as_deref())?;
    let band = HeightBand::or_of(arguments.height_band, PlanarBand::default());
    let mut odometry = arguments.known_map.lidar_odometry()?;
    let mut trajectory = Trajectory::create(&arguments.trajectory)?;
    let mut intake = Intake::new(ReadingSettings {
        scans: ScanSettings {
            band,
            ..ScanSettings::default()
        },
        ..ReadingSettings::default()
    });
    let mut stream = RecordedStream::of(&channel, Stream::Scan);
    let topics = [channel.topic.as_str()];
    let mut progress = Progress::over(recording.count(&topics));
    let began = clock.elapsed();
    let mut times = ScanTimes::default();
    let (mut summary, mut first, mut last) = (OdometrySummary::default(), None, None);
    for message in recording.messages(&topics)? {
        let message = message?;
        let before = thread_cpu();
        let taken = stream.take(&mut intake, &message);
        let event = taken.and_then(|taken| taken.events.into_iter().next());
        let pose = event.and_then(|decoded| match decoded.event {
            Event::Scan(scan) => odometry.process(&scan),
            _ => None,
        });
        times.add_scan(thread_cpu().saturating_sub(before));
        progress.advance();
        let Some(pose) = pose else {
            summary.scans_rejected += 1;
            continue;
        };
        trajectory.add(pose.stamp, &pose.lidar_in_odom)?;
        summary.add(&pose, &mut first, last.as_ref());
        last = Some(pose.lidar_in_odom);
    }
    progress.finish();
    stream.check_usable(recording.path())?;
    trajectory.finish()?;
    let wall = clock.elapsed().saturating_sub(began);
    let timing = times.timing(summary.duration_s, wall);
    summary.scan_median_ms = timing.scan_median_ms;
    summary.scan_p99_ms = timing.scan_p99_ms;
    summary.cpu_s = timing.cpu_s;
    summary.realtime_factor = timing.realtime_factor;
    if let Some(refusals) = stream.refusals() {
        eprintln!("fleetcal: {refusals}");
    }
    if arguments.json {
        print_json(&summary)
    } else {
        print_text(&in_words(&summary))
    }
}

fn in_words(summary: &OdometrySummary) -> String {
    let OdometrySummary {
        scans,
        scans_rejected,
        tracking,
        map_restarts,
        distance_m,
        ..
    } = summary;
    format!(
        "{scans} scans, {scans_rejected} rejected; {distance_m:.2} m in {:.1} s\n\
         tracking {}, degraded {}, lost {}, recovered {}; map restarted {map_restarts} times\n\
         {:.3} ms a scan (99 % under {:.3} ms), {:.2} s of CPU time, {:.0} times real time\n",
        summary.duration_s,
        tracking.tracking,
        tracking.degraded,
        tracking.lost,
        tracking.recovered,
        summary.scan_median_ms,
        summary.scan_p99_ms,
        summary.cpu_s,
        summary.realtime_factor,
    )
}
