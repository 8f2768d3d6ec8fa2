//! The `fleetcal` command.

use std::process::ExitCode;

use clap::Parser;
use fleetcal::clock::SystemClock;
use fleetcal::command::{Cli, Command, CommandError, calibrate, odometry};
use tracing_subscriber::EnvFilter;

fn main() -> ExitCode {
    let cli = Cli::parse();
    log();
    match run(&cli.command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("fleetcal: {error}");
            ExitCode::from(error.exit_status())
        }
    }
}

fn run(command: &Command) -> Result<(), CommandError> {
    let clock = SystemClock::start();
    match command {
        Command::Calibrate(arguments) => calibrate::run(arguments, &clock),
        Command::Odometry(arguments) => odometry::run(arguments, &clock),
    }
}

/// Logs go to standard error; `RUST_LOG` chooses which.
fn log() {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .init();
}
