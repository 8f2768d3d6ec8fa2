//! `fleetcal demo`: the service, its router and a small simulated fleet in one process.

use std::net::{SocketAddr, TcpListener};
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use clap::Args;
use fleetcal_clock::SharedClock;
use fleetcal_command::output::print_text;
use fleetcal_command::signals::Signals;
use fleetcal_config::{Config, RobotEntry};
use fleetcal_domain::access::{AccountName, Actor, Grant, Password, PasswordHash, Role};
use fleetcal_domain::robot::{Mount, RobotConfig, RobotState, ValueRefused, Wheelbase};
use fleetcal_fleet::FleetHandle;
use fleetcal_operations::accounts::{UserChange, change_user};
use fleetcal_operations::entropy;
use fleetcal_proto::Keys;
use fleetcal_proto::signing::TrustedKeys;
use fleetcal_robot::fleet::{
    DriveMessages, FleetOptions, SimulatedRobot, run_fleet, simulated_robots,
};
use fleetcal_store::Store;
use tokio_util::sync::CancellationToken;

use crate::command::CommandError;
use crate::command::stopping::stop_in_time;
use crate::database::DatabaseArguments;
use crate::service::{Service, ServiceError};

/// Interval at which the demo checks its robots' progress.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// Arguments of `fleetcal demo`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Number of robots
    #[arg(long, value_name = "N", default_value_t = 6)]
    pub robots: usize,
    /// Keep the data in this folder; otherwise each demo starts with an empty one
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    #[command(flatten)]
    database: DatabaseArguments,
    /// Address of the dashboard
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:8080")]
    pub http: SocketAddr,
    /// Zenoh endpoint between the robots and the service
    #[arg(long, value_name = "ENDPOINT", default_value = "tcp/127.0.0.1:7447")]
    pub listen: String,
    /// Seed of the robots' errors and the sensors' noise
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub seed: u64,
    /// Seconds that pass for the robots in one of real time
    #[arg(long, value_name = "TIMES", default_value_t = NonZeroU32::MIN)]
    pub rate: NonZeroU32,
}

/// Runs until SIGTERM or SIGINT.
///
/// # Errors
/// An address is in use or the data folder cannot be used.
pub async fn run(arguments: &Arguments, clock: SharedClock) -> Result<(), CommandError> {
    let robots = simulated_robots(arguments.robots, arguments.seed)?;
    let data = match &arguments.data {
        Some(data) => data.clone(),
        None => fresh_folder(arguments.http)?,
    };
    let mut config = Config {
        data,
        http: arguments.http,
        listen: vec![arguments.listen.clone()],
        robots: robots.iter().map(entry).collect::<Result<_, _>>()?,
        ..Config::default()
    };
    arguments.database.put_into(&mut config)?;
    let mut signals = Signals::listen()?;
    let service = Service::start(config, Arc::clone(&clock)).await?;
    let accounts = seed_accounts(service.store()).await?;
    print_text(&format!(
        "{} simulated robots drive: http://{}\n{accounts}Each is calibrated after 20 to 90 s of \
         driving; then approve its calibration as approver.\nCtrl-C ends the demo.\n",
        robots.len(),
        service.http_address(),
    ))?;
    let progress = tokio::spawn(say_progress(service.fleet().clone(), Arc::clone(&clock)));
    let stop = CancellationToken::new();
    let fleet = tokio::spawn(run_fleet(
        FleetOptions {
            robots,
            connect: vec![arguments.listen.clone()].into(),
            keys: Keys::default(),
            trusted: Some(TrustedKeys::from(service.lifecycle().public_key())),
            start_stamp_ns: clock.now().0,
            rate: arguments.rate,
            drive_messages: DriveMessages::default(),
        },
        stop.clone(),
    ));
    signals.stop().await;
    stop.cancel();
    progress.abort();
    let ended = fleet.await;
    stop_in_time(service, signals).await?;
    ended??;
    Ok(())
}

/// Prints the number of calibrated robots each time that it grows, until all are.
async fn say_progress(fleet: FleetHandle, clock: SharedClock) -> Result<(), CommandError> {
    let began = clock.elapsed();
    let mut look = tokio::time::interval(LOOK_EVERY);
    let mut said = 0;
    loop {
        look.tick().await;
        let robots = fleet.robots();
        let states = robots.iter().map(|robot| robot.state);
        let calibrated = states
            .filter(|&state| state == RobotState::Calibrated)
            .count();
        if calibrated > said {
            said = calibrated;
            let after_s = clock.elapsed().saturating_sub(began).as_secs();
            print_text(&format!(
                "{calibrated} of {} robots are calibrated after {after_s} s.\n",
                robots.len()
            ))?;
        }
        if said == robots.len() {
            return Ok(());
        }
    }
}

/// Accounts of the demo: one of each role, and a second approver, since a proposer cannot approve.
const ACCOUNTS: [(&str, Role); 5] = [
    ("admin", Role::Admin),
    ("approver", Role::Approver),
    ("approver2", Role::Approver),
    ("operator", Role::Operator),
    ("viewer", Role::Viewer),
];
/// Digits of the demo's passwords: 64 bits, short enough to type.
const PASSWORD_DIGITS: usize = 16;

/// Makes the demo's accounts in a store without users; returns their description.
async fn seed_accounts(store: &Store) -> Result<String, CommandError> {
    if store.has_users().await? {
        return Ok("The accounts are those of this folder's first demo.\n".to_owned());
    }
    let mut told = vec!["Sign in with one of these accounts, made for this demo:\n".to_owned()];
    for (name, role) in ACCOUNTS {
        let random = entropy::secret()?;
        let digits = random.iter().map(|byte| format!("{byte:02x}"));
        let text: String = digits.take(PASSWORD_DIGITS / 2).collect();
        let change = UserChange::Create {
            name: AccountName::parse(name)?,
            grant: Grant::of_person(role)?,
            password: PasswordHash::of(&Password::parse(&text)?, &entropy::salt()?)?,
            key: None,
        };
        change_user(store, Actor::service(), change).await?;
        told.push(format!("  {name:<10} {text}\n"));
    }
    Ok(told.concat())
}

/// Makes the robot's entry as an operator would register it: its drawing, not its truth.
fn entry(robot: &SimulatedRobot) -> Result<RobotEntry, ValueRefused> {
    let wheelbase = Wheelbase::try_from(robot.wheelbase_m())?;
    let mut config = RobotConfig::of_vehicle(robot.model(), wheelbase);
    config.nominal_extrinsics = Some(Mount::try_from(robot.nominal())?);
    Ok(RobotEntry {
        id: robot.id.clone(),
        config,
    })
}

/// Empties the demo's own folder. Its name holds the port, and the port is free: no other demo uses
/// it.
fn fresh_folder(http: SocketAddr) -> Result<PathBuf, CommandError> {
    drop(
        TcpListener::bind(http).map_err(|source| ServiceError::Http {
            address: http,
            source,
        })?,
    );
    let folder = std::env::temp_dir().join(format!("fleetcal-demo-{}", http.port()));
    remove(&folder).map_err(|source| fleetcal_command::CommandError::Write {
        path: folder.clone(),
        source,
    })?;
    Ok(folder)
}

fn remove(folder: &Path) -> std::io::Result<()> {
    match std::fs::remove_dir_all(folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}
