//! `fleetcal simulate`: closed-loop simulated robots on the wire, or a recording of one.

use std::path::PathBuf;

use clap::Args;
use fleetcal_proto::signing::{PublicKey, TrustedKeys};
use fleetcal_proto::{KeyRoot, Keys};
use fleetcal_robot::Connection;
use fleetcal_robot::fleet::{
    FleetOptions, RobotSummary, SimulatedRobot, record, run_fleet, simulated_robots, truth_path,
};
use tokio_util::sync::CancellationToken;

use crate::clock::SharedClock;
use crate::command::CommandError;
use crate::command::output::print_text;
use crate::command::stopping::Signals;

/// What `fleetcal simulate` takes.
#[derive(Debug, Args)]
pub struct Arguments {
    /// How many robots
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub robots: usize,
    /// Drive in real time, connected to this Zenoh endpoint; may be repeated
    #[arg(
        short = 'e',
        long,
        value_name = "ENDPOINT",
        required_unless_present_any = ["zenoh_config", "record"]
    )]
    pub connect: Vec<String>,
    /// A native Zenoh configuration for each robot, taken as it is; --connect replaces the endpoints
    /// in it
    #[arg(short = 'c', long, env = "ZENOH_CONFIG", value_name = "FILE")]
    pub zenoh_config: Option<PathBuf>,
    /// Record one robot instead, with its truth beside it
    #[arg(long, value_name = "OUT.mcap", conflicts_with = "connect")]
    pub record: Option<PathBuf>,
    /// Length of the recording, in seconds
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 120.0,
        requires = "record"
    )]
    pub duration: f64,
    /// The service's public key, as `GET /api/v1/signing-key` shows it: the robots apply, at once
    /// and in motion, what is approved for them; without it they take no calibration; may be
    /// repeated
    #[arg(long, value_name = "PUBLICKEY", conflicts_with = "record")]
    pub service_key: Vec<PublicKey>,
    /// What the robots' faults and the sensors' noise are drawn from
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub seed: u64,
    /// First chunk of every key
    #[arg(long, value_name = "CHUNK", default_value = "fleet", value_parser = KeyRoot::parse)]
    pub root: KeyRoot,
}

/// Drives until SIGTERM or SIGINT, or records.
///
/// # Errors
/// One sentence, with the exit status that goes with it.
pub async fn run(arguments: &Arguments, clock: SharedClock) -> Result<(), CommandError> {
    let robots = simulated_robots(arguments.robots, arguments.seed)?;
    match &arguments.record {
        Some(path) => record_one(&robots, arguments.duration, path.clone()).await,
        None => drive(robots, arguments, clock).await,
    }
}

async fn record_one(
    robots: &[SimulatedRobot],
    duration_s: f64,
    path: PathBuf,
) -> Result<(), CommandError> {
    let [robot] = robots else {
        return Err(CommandError::OneRobot {
            robots: robots.len(),
        });
    };
    let (robot, recorded) = (robot.clone(), path.clone());
    let recording =
        tokio::task::spawn_blocking(move || record(&robot, duration_s, &recorded)).await?;
    let truth = recording?;
    print_text(&format!(
        "{}: {duration_s} s of {}, wheelbase {} m; the truth is in {}\n",
        path.display(),
        truth.robot,
        truth.vehicle.wheelbase_m,
        truth_path(&path).display(),
    ))
}

async fn drive(
    robots: Vec<SimulatedRobot>,
    arguments: &Arguments,
    clock: SharedClock,
) -> Result<(), CommandError> {
    let trusted = match arguments.service_key.as_slice() {
        [] => None,
        keys => Some(TrustedKeys::new(keys.to_vec())?),
    };
    let mut signals = Signals::listen()?;
    let options = FleetOptions {
        robots,
        connect: Connection {
            endpoints: arguments.connect.clone(),
            zenoh_config: arguments.zenoh_config.clone(),
        },
        keys: Keys::new(arguments.root.clone()),
        trusted,
        start_stamp_ns: clock.now_ns(),
    };
    let stop = CancellationToken::new();
    let fleet = run_fleet(options, stop.clone());
    tokio::pin!(fleet);
    let summaries = tokio::select! {
        ended = &mut fleet => ended?,
        () = signals.stop() => {
            stop.cancel();
            fleet.await?
        }
    };
    print_text(&in_words(&summaries))
}

/// One line for each robot.
fn in_words(summaries: &[RobotSummary]) -> String {
    let line = |summary: &RobotSummary| {
        let RobotSummary {
            id,
            drive_samples,
            scans,
            late,
            generation,
        } = summary;
        format!(
            "{id}: {drive_samples} drive samples and {scans} scans sent, {late} left out as late, \
             calibration {generation}\n"
        )
    };
    summaries.iter().map(line).collect()
}
