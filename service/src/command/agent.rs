//! `fleetcal agent`: the robot's side of an approved calibration.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use fleetcal_proto::signing::{PublicKey, TrustedKeys};
use fleetcal_proto::{KeyRoot, Keys, RobotId};
use fleetcal_robot::agent::{AgentOptions, Hook, Limits, run_agent};
use tokio_util::sync::CancellationToken;

use crate::clock::SharedClock;
use crate::command::CommandError;
use crate::command::connection::ConnectionArguments;
use crate::command::output::print_text;
use crate::command::stopping::Signals;

/// What a hook has to know, and what else is not said by one flag.
const LONG_HELP: &str = "\
The agent asks the service for what is approved for its robot: at its start, whenever a service comes \
up, and once a minute; what the service pushes arrives at once. A document is taken when it is signed \
with a trusted key, for this robot, of a higher generation than any before, and inside the robot's \
limits; else it is refused, and the service is told why. The file is replaced as a whole or not at \
all. Without the service's confirmation in time the former file comes back by itself. What the agent \
remembers stands beside the file, in FILE.agent.json.

The hook is called, without a shell, with FLEETCAL_CALL in its environment:
  check     may the values be applied now?  exit 0: yes, 75: busy, ask again in 15 s
  applied   the file says them: reload it.  exit 0: done, 75: not now, the former file comes back
  reverted  the former file is back: reload it
Any other exit status is a failure; what the hook says on standard error is its reason. After a \
restart of the agent a call may come once more. FLEETCAL_ROBOT, FLEETCAL_GENERATION and FLEETCAL_FILE \
say what it is about; the signed document is on standard input.

Exit status: 0 told to stop, 2 wrong flags or files, 70 a fault of the agent, 74 reading, writing or \
connecting failed.";

/// Longest time that a hook may be given, s: deadlines wait for its answer.
const HOOK_TIMEOUT_MAX_S: u64 = 600;

/// What `fleetcal agent` takes.
#[derive(Debug, Args)]
#[command(after_long_help = LONG_HELP)]
pub struct Arguments {
    /// Whose agent it is
    #[arg(long, value_name = "ID", value_parser = RobotId::parse)]
    pub robot: RobotId,
    /// Where the service is.
    #[command(flatten)]
    pub connection: ConnectionArguments,
    /// The file that the robot's software reads its calibration from, YAML or JSON by its ending
    /// (.yaml, .yml, .json); it need not be there yet
    #[arg(long, value_name = "FILE")]
    pub apply: PathBuf,
    /// The service's public key, as `GET /api/v1/signing-key` shows it; may be repeated
    #[arg(long, value_name = "PUBLICKEY", required = true)]
    pub service_key: Vec<PublicKey>,
    /// A program that is asked before values are written, and told when they were and when they
    /// went; it finds the document on its standard input
    #[arg(long, value_name = "PROGRAM")]
    pub hook: Option<PathBuf>,
    /// An argument of the hook; may be repeated
    #[arg(
        long,
        value_name = "ARGUMENT",
        requires = "hook",
        allow_hyphen_values = true
    )]
    pub hook_arg: Vec<String>,
    /// A hook that takes longer is killed and has failed
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 60,
        value_parser = clap::value_parser!(u64).range(1..=HOOK_TIMEOUT_MAX_S)
    )]
    pub hook_timeout: u64,
    /// A TOML file with the robot's own limits, `steering_offset_rad = [-0.1, 0.1]` and so on;
    /// what it leaves out keeps its default
    #[arg(long, value_name = "FILE")]
    pub limits: Option<PathBuf>,
    /// Show the robot as present while the agent runs, for robots whose streams do not
    #[arg(long)]
    pub alive: bool,
    /// First chunk of every key
    #[arg(long, value_name = "CHUNK", default_value = "fleet", value_parser = KeyRoot::parse)]
    pub root: KeyRoot,
}

/// Runs until SIGTERM or SIGINT.
///
/// # Errors
/// One sentence, with the exit status that goes with it.
pub async fn run(arguments: &Arguments, clock: SharedClock) -> Result<(), CommandError> {
    let limits = match &arguments.limits {
        Some(path) => read_limits(path)?,
        None => Limits::default(),
    };
    let mut signals = Signals::listen()?;
    let options = AgentOptions {
        robot: arguments.robot.clone(),
        connect: arguments.connection.connection(),
        keys: Keys::new(arguments.root.clone()),
        apply: arguments.apply.clone(),
        trusted: TrustedKeys::new(arguments.service_key.clone())?,
        limits,
        hook: hook(arguments),
        holds_alive_token: arguments.alive,
        start_ns: clock.now_ns(),
    };
    let stop = CancellationToken::new();
    let agent = run_agent(options, stop.clone());
    tokio::pin!(agent);
    let generation = tokio::select! {
        ended = &mut agent => ended?,
        () = signals.stop() => {
            stop.cancel();
            agent.await?
        }
    };
    let robot = &arguments.robot;
    print_text(&format!("{robot}: holds calibration {generation}\n"))
}

fn hook(arguments: &Arguments) -> Option<Hook> {
    Some(Hook {
        program: arguments.hook.clone()?,
        arguments: arguments.hook_arg.clone(),
        timeout: Duration::from_secs(arguments.hook_timeout),
    })
}

fn read_limits(path: &Path) -> Result<Limits, CommandError> {
    let text = std::fs::read_to_string(path).map_err(|source| CommandError::Read {
        path: path.to_owned(),
        source,
    })?;
    toml::from_str(&text).map_err(|source| CommandError::Limits {
        path: path.to_owned(),
        source: Box::new(source),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits(text: &str) -> Result<Limits, CommandError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("limits.toml");
        std::fs::write(&path, text).unwrap();
        read_limits(&path)
    }

    #[test]
    fn limits_keep_their_defaults_and_refuse_what_they_do_not_know() {
        let read = limits("steering_offset_rad = [-0.1, 0.1]\nlidar_x_m = [0, 1]\n").unwrap();
        let expected = Limits {
            steering_offset_rad: fleetcal_robot::agent::Range::new(-0.1, 0.1).unwrap(),
            lidar_x_m: fleetcal_robot::agent::Range::new(0.0, 1.0).unwrap(),
            ..Limits::default()
        };
        assert_eq!(read, expected);
        for (text, wanted) in [
            ("steering = [0, 1]", "steering"),
            ("lidar_x_m = [1, 0]", "[1, 0]"),
            ("lidar_x_m = 1", "lidar_x_m"),
        ] {
            let error = limits(text).unwrap_err();
            let sentence = error.to_string();
            assert!(
                sentence.contains(wanted) && error.exit_status() == 2,
                "{sentence}"
            );
        }
        let missing = read_limits(Path::new("/nowhere/limits.toml")).unwrap_err();
        assert_eq!(missing.exit_status(), 74);
    }
}
