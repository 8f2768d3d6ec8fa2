//! The `fleetcal` command.

use std::error::Error as _;
use std::io::IsTerminal as _;
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use clap::Parser;
use fleetcal::command::{
    Cli, Command, CommandError, acl, audit, backup, check_config, completions, demo, key, man,
    restore, serve, store, support, token, user,
};
use fleetcal::environment::{self, Peers};
use fleetcal_clock::{Clock as _, SharedClock, SystemClock};
use fleetcal_command::zenoh_words::{WithoutPlaces, without_places};
use fleetcal_command::{agent, calibrate, doctor, odometry, replay, schema, simulate, verify};
use fleetcal_domain::limits::ZENOH_LOG_LINES_PER_HOUR_MAX;
use fleetcal_fleet::budget::Budget;
use fleetcal_support::Remembering;
use tracing_subscriber::filter::{EnvFilter, FilterExt as _, dynamic_filter_fn};
use tracing_subscriber::layer::{Layer as _, SubscriberExt as _};
use tracing_subscriber::util::SubscriberInitExt as _;

/// Time that a library's working threads get after a command has ended.
const LEFT_OVER_TIMEOUT: Duration = Duration::from_millis(100);

/// Allocator that returns memory after a flood. glibc's arenas, one for each of Zenoh's threads,
/// return little: after 2,000 sign-ins 20 MiB stayed there.
#[global_allocator]
static ALLOCATOR: tikv_jemallocator::Jemalloc = tikv_jemallocator::Jemalloc;

fn main() -> ExitCode {
    let cli = Cli::parse();
    log();
    let peers = match &cli.command {
        Command::Serve(arguments) => Some((Peers::Many, arguments.zenoh())),
        Command::Demo(_) => Some((Peers::Many, Vec::new())),
        Command::Agent(_) | Command::Replay(_) | Command::Simulate(_) => {
            Some((Peers::One, Vec::new()))
        }
        _ => None,
    };
    if let Some((peers, zenoh)) = peers
        && let Err(error) = environment::ensure(peers, zenoh)
    {
        tracing::warn!(
            %error,
            "Zenoh has two threads: over TLS the process may crash, and a few sessions that declare many \
             keys can hold up the data of all others"
        );
    }
    match run(&cli.command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("fleetcal: {}", without_places(&in_one_sentence(&error)));
            ExitCode::from(error.exit_status())
        }
    }
}

fn run(command: &Command) -> Result<(), CommandError> {
    let clock: SharedClock = Arc::new(SystemClock::start());
    match command {
        Command::Calibrate(arguments) => Ok(calibrate::run(arguments, &*clock)?),
        Command::Doctor(arguments) => Ok(doctor::run(arguments)?),
        Command::Odometry(arguments) => Ok(odometry::run(arguments, &*clock)?),
        Command::Serve(arguments) => on_runtime(serve::run(arguments, clock)),
        Command::Replay(arguments) => on_runtime(replay::run(arguments)),
        Command::Agent(arguments) => on_runtime(agent::run(arguments, clock)),
        Command::Simulate(arguments) => on_runtime(simulate::run(arguments, clock)),
        Command::Demo(arguments) => on_runtime(demo::run(arguments, clock)),
        Command::Token(arguments) => on_runtime(token::run(arguments, clock)),
        Command::User(arguments) => on_runtime(user::run(arguments, clock)),
        Command::Key(arguments) => key::run(arguments, &clock),
        Command::Audit(arguments) => on_runtime(audit::run(arguments)),
        Command::Support(arguments) => on_runtime(support::run(arguments)),
        Command::Backup(arguments) => on_runtime(backup::run(arguments)),
        Command::Restore(arguments) => on_runtime(restore::run(arguments)),
        Command::Store(arguments) => on_runtime(store::run(arguments)),
        Command::Acl(arguments) => acl::run(arguments),
        Command::CheckConfig(arguments) => check_config::run(arguments),
        Command::Completions(arguments) => completions::run(arguments),
        Command::Schema(arguments) => Ok(schema::run(arguments)?),
        Command::Verify(arguments) => Ok(verify::run(arguments)?),
        Command::Man(arguments) => man::run(arguments),
    }
}

/// Runs an asynchronous command, on as many threads as there are cores.
fn on_runtime<E>(command: impl Future<Output = Result<(), E>>) -> Result<(), CommandError>
where
    CommandError: From<E>,
{
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()?;
    let result = runtime.block_on(command);
    runtime.shutdown_timeout(LEFT_OVER_TIMEOUT);
    Ok(result?)
}

/// Formats an error with its causes, each once.
fn in_one_sentence(error: &CommandError) -> String {
    let mut sentence = error.to_string();
    let mut source = error.source();
    while let Some(reason) = source {
        let reason_text = reason.to_string();
        if !sentence.contains(&reason_text) {
            sentence = format!("{sentence}: {reason_text}");
        }
        source = reason.source();
    }
    sentence
}

/// Sets up logging to standard error, filtered by `RUST_LOG`. Zenoh's lines, which peers can cause
/// at will, have a budget.
fn log() {
    let chosen = EnvFilter::try_from_default_env()
        .unwrap_or_else(|_| EnvFilter::new("info,zenoh=warn,zenoh_transport=warn"));
    let clock = SystemClock::start();
    let budget = Mutex::new(Budget::per_hour(ZENOH_LOG_LINES_PER_HOUR_MAX));
    let within_budget = dynamic_filter_fn(move |event, _| {
        let mut budget = budget.lock().unwrap_or_else(PoisonError::into_inner);
        !event.target().starts_with("zenoh") || budget.take(clock.elapsed(), 1)
    });
    let lines = tracing_subscriber::fmt::layer()
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(|| Remembering(WithoutPlaces(std::io::stderr())))
        .with_filter(chosen.and(within_budget));
    tracing_subscriber::registry().with(lines).init();
}
