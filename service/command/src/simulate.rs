//! `fleetcal simulate`: closed-loop simulated robots on the wire, or a recording of one.

use std::num::NonZeroU32;
use std::path::{Path, PathBuf};

use clap::Args;
use fleetcal_clock::SharedClock;
use fleetcal_config::line_of;
use fleetcal_model::Pose2;
use fleetcal_proto::signing::{PublicKey, TrustedKeys};
use fleetcal_proto::{KeyRoot, Keys, endpoint};
use fleetcal_robot::Connection;
use fleetcal_robot::fleet::{
    DriveMessages, FleetOptions, RobotSummary, START_STAMP_S, SimulatedRobot, record_wrong,
    run_fleet, simulated_robots, truth_path,
};
use fleetcal_robot::simulator::{Imperfections, WrongInput};
use tokio_util::sync::CancellationToken;

use crate::output::print_text;
use crate::signals::Signals;
use crate::{Boxed, CommandError};

/// Arguments of `fleetcal simulate`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Number of robots
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub robots: usize,
    /// Drive in real time, connected to this Zenoh endpoint; may be repeated
    #[arg(
        short = 'e',
        long,
        value_name = "ENDPOINT",
        value_parser = endpoint::parse,
        required_unless_present_any = ["zenoh_config", "record", "configuration"]
    )]
    pub connect: Vec<String>,
    /// A native Zenoh configuration for each robot, in which QUIC endpoints are set to one stream;
    /// --connect replaces its endpoints
    #[arg(short = 'c', long, env = "ZENOH_CONFIG", value_name = "FILE")]
    pub zenoh_config: Option<PathBuf>,
    /// Print the configuration of these robots for fleetcal.toml instead: their drawings, not their
    /// true values
    #[arg(long, conflicts_with_all = ["connect", "record"])]
    pub configuration: bool,
    /// Record one robot instead, with its true values in a file beside it
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
    /// Stamp that the recording begins with, in whole seconds since 1970: one robot's recordings
    /// follow one another
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = START_STAMP_S,
        requires = "record"
    )]
    pub start_stamp: i32,
    /// Turn each robot's LiDAR by so much to the left, in degrees: the same robot after a knock or
    /// a reassembly
    #[arg(
        long,
        value_name = "DEGREES",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub turn_lidar: f64,
    /// The service's public key, from `GET /api/v1/signing-key`: the robots apply, at once and in
    /// motion, the approved calibration for them; without it they accept no calibration; may be
    /// repeated
    #[arg(long, value_name = "PUBLICKEY", conflicts_with = "record")]
    pub service_key: Vec<PublicKey>,
    /// Seed of the robots' faults and of the sensors' noise
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub seed: u64,
    /// Seconds that pass for the robots in one of real time
    #[arg(long, value_name = "TIMES", default_value_t = NonZeroU32::MIN, conflicts_with = "record")]
    pub rate: NonZeroU32,
    /// Send each drive sample in a message of its own, as ROS 2 robots do, instead of up to 100 ms
    /// of them in one
    #[arg(long, conflicts_with = "record")]
    pub single_samples: bool,
    /// Imperfections of the robots that the estimator's model does not cover, in the form of
    /// examples/imperfections.toml; a recording's truth file names it
    #[arg(long, value_name = "FILE")]
    pub imperfections: Option<PathBuf>,
    /// Wrong inputs of the recording by name, as an integrator makes them: `steering_sign,degrees`; its
    /// truth names them
    #[arg(long, value_name = "NAMES", value_delimiter = ',', requires = "record", value_parser = wrong_input)]
    pub wrong: Vec<WrongInput>,
    /// First chunk of every key
    #[arg(long, value_name = "CHUNK", default_value = "fleet", value_parser = KeyRoot::parse)]
    pub root: KeyRoot,
}

/// Drives until SIGTERM or SIGINT, or records.
///
/// # Errors
/// One sentence, with its exit status.
pub fn run(arguments: &Arguments, clock: SharedClock) -> Boxed<'_> {
    Box::pin(perform(arguments, clock))
}

async fn perform(arguments: &Arguments, clock: SharedClock) -> Result<(), CommandError> {
    let mut robots = simulated_robots(arguments.robots, arguments.seed)?;
    if let Some(path) = &arguments.imperfections {
        make_imperfect(&mut robots, path)?;
    }
    for robot in &mut robots {
        robot.config.start_stamp_ns = i64::from(arguments.start_stamp) * 1_000_000_000;
        robot.config.vehicle.lidar_in_base.yaw_rad += arguments.turn_lidar.to_radians();
    }
    if arguments.configuration {
        return print_text(&robots.iter().map(entry).collect::<String>());
    }
    match &arguments.record {
        Some(path) => record_one(&robots, arguments, path.clone()).await,
        None => drive(robots, arguments, clock).await,
    }
}

/// Reads the name of a wrong input that shows in a recording of scans.
fn wrong_input(name: &str) -> Result<WrongInput, String> {
    let is_of_scans = |input: &WrongInput| input.needs_scans() != Some(false);
    let found = WrongInput::by_name(name).filter(is_of_scans);
    found.ok_or_else(|| {
        let all = WrongInput::ALL.iter().filter(|input| is_of_scans(input));
        let names: Vec<&str> = all.map(|input| input.name()).collect();
        format!("expected one of {}", names.join(", "))
    })
}

/// Writes a robot's part of `fleetcal.toml`.
fn entry(robot: &SimulatedRobot) -> String {
    let Pose2 { x_m, y_m, yaw_rad } = robot.nominal();
    let model = robot.model().name();
    format!(
        "[[robot]]\nid = \"{}\"\nmodel = \"{model}\"\nwheelbase_m = {:?}\n\
         nominal_extrinsics = {{ x_m = {x_m:?}, y_m = {y_m:?}, yaw_rad = {yaw_rad:?} }}\n\n",
        robot.id,
        robot.wheelbase_m(),
    )
}

/// Applies the imperfections of a file to every robot.
fn make_imperfect(robots: &mut [SimulatedRobot], path: &Path) -> Result<(), CommandError> {
    let text = std::fs::read_to_string(path).map_err(|source| CommandError::Read {
        path: path.to_owned(),
        source,
    })?;
    let refused = |reason: String| CommandError::Imperfections {
        path: path.to_owned(),
        reason,
    };
    let imperfections: Imperfections = toml::from_str(&text).map_err(|error| {
        let line = line_of(&text, error.span());
        let message = error.message().replace('\n', ", ");
        refused(format!("line {line}: {message}"))
    })?;
    for robot in robots {
        robot.config.imperfections = imperfections;
        let checked = robot.config.check();
        checked.map_err(|error| refused(error.to_string()))?;
    }
    Ok(())
}

async fn record_one(
    robots: &[SimulatedRobot],
    arguments: &Arguments,
    path: PathBuf,
) -> Result<(), CommandError> {
    let [robot] = robots else {
        return Err(CommandError::OneRobot {
            robots: robots.len(),
        });
    };
    let (robot, recorded) = (robot.clone(), path.clone());
    let (duration_s, wrong) = (arguments.duration, arguments.wrong.clone());
    let recording =
        tokio::task::spawn_blocking(move || record_wrong(&robot, duration_s, &recorded, &wrong))
            .await?;
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
        start_stamp_ns: clock.now().0,
        rate: arguments.rate,
        drive_messages: if arguments.single_samples {
            DriveMessages::Single
        } else {
            DriveMessages::Several
        },
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

/// Writes one line for each robot.
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

#[cfg(test)]
mod tests {
    use fleetcal_description::Description;
    use fleetcal_domain::robot::DescribedConfig;
    use fleetcal_robot::fleet::urdf;
    use fleetcal_robot::simulator::ImperfectionKind;

    use super::*;

    fn imperfect(text: &str) -> Result<Imperfections, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("imperfections.toml");
        std::fs::write(&path, text).unwrap();
        let mut robots = simulated_robots(3, 1).unwrap();
        make_imperfect(&mut robots, &path).map_err(|error| {
            assert_eq!(error.exit_status(), 2);
            error.to_string()
        })?;
        let given = robots[0].config.imperfections;
        assert!(
            robots
                .iter()
                .all(|robot| robot.config.imperfections == given)
        );
        Ok(given)
    }

    /// Returns the keys of all imperfections that are set.
    fn keys(imperfections: &Imperfections) -> Vec<String> {
        let table = toml::Table::try_from(imperfections).unwrap();
        let mut keys = Vec::new();
        for (part, values) in &table {
            for (key, value) in values.as_table().unwrap() {
                let set = value.as_float().is_some_and(|size| size != 0.0)
                    || value.as_bool().unwrap_or_default();
                keys.extend(set.then(|| format!("{part}.{key}")));
            }
        }
        keys
    }

    #[test]
    fn the_example_has_every_key_at_its_typical_size() {
        let text = include_str!("../../../examples/imperfections.toml");
        let example = imperfect(text).unwrap();
        for kind in ImperfectionKind::ALL {
            let typical = Imperfections::typical(kind);
            for key in keys(&typical) {
                let wanted = value(&typical, &key);
                let written = value(&example, &key);
                // Lag and delay stand for one another, and a robot has one scan rate.
                if !["vehicle.steering_delay_s", "lidar.scan_rate_hz"].contains(&key.as_str()) {
                    let near = (written - wanted).abs() <= 0.01 * wanted.abs();
                    assert!(near, "{key}: {written} {wanted}");
                }
            }
        }
        let written: toml::Table = toml::from_str(text).unwrap();
        let full = toml::Table::try_from(example).unwrap();
        assert_eq!(written, full, "the example has every key");
    }

    fn value(imperfections: &Imperfections, key: &str) -> f64 {
        let table = toml::Table::try_from(imperfections).unwrap();
        let (part, name) = key.split_once('.').unwrap();
        let value = &table[part][name];
        let flag = value.as_bool().map(|set| f64::from(u8::from(set)));
        value.as_float().or(flag).unwrap()
    }

    #[test]
    fn what_cannot_be_is_refused_by_name() {
        let refused = |text: &str| imperfect(text).unwrap_err();
        let unknown = refused("[vehicle]\nsteering_gian = 0.01\n");
        assert!(
            unknown.contains("line 2: unknown field `steering_gian`, expected one of"),
            "{unknown}"
        );
        let value = refused("[clocks]\nlost_messages = 2.0\n");
        assert!(
            value.contains("imperfections.clocks.lost_messages"),
            "{value}"
        );
        let kind = refused("[scanner]\n\nuntimed_beams = 1\n");
        assert!(
            kind.contains("line 3:") && kind.contains("a boolean"),
            "{kind}"
        );
        let missing = make_imperfect(&mut [], Path::new("/nowhere/flaws.toml")).unwrap_err();
        assert!(missing.to_string().contains("/nowhere/flaws.toml"));
    }

    #[test]
    fn a_robots_own_description_gives_its_vehicle() {
        for robot in simulated_robots(3, 1).unwrap() {
            let mut description = Description::default();
            description.set_urdf(&urdf(&robot)).unwrap();
            let described = DescribedConfig::of(&description.propose(None));
            assert_eq!(described.model, Some(robot.model()));
            let wheelbase_m = described.wheelbase_m.unwrap().metres();
            assert!((wheelbase_m - robot.wheelbase_m()).abs() < 1e-9);
            let mount = described.nominal_extrinsics.unwrap().pose();
            let apart = mount.between(&robot.nominal());
            assert!(apart.x_m.hypot(apart.y_m) < 1e-9 && apart.yaw_rad.abs() < 1e-9);
            let document = described.document(Vec::new(), None);
            assert_eq!(
                (document.missing, document.remarks),
                (Vec::new(), Vec::new())
            );
        }
    }

    #[test]
    fn an_empty_file_is_a_robot_that_obeys_the_model() {
        assert!(imperfect("").unwrap().is_none());
    }
}
