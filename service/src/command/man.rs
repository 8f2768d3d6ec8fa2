//! `fleetcal man`: the manual pages, one for each command.

use std::path::PathBuf;

use clap::{Args, CommandFactory};

use crate::command::{Cli, CommandError};

/// Arguments of `fleetcal man`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The folder to write them into, such as /usr/local/share/man/man1; it must exist
    #[arg(value_name = "DIR")]
    pub to: PathBuf,
}

/// Writes `fleetcal.1`, `fleetcal-serve.1` and so on.
///
/// # Errors
/// A page cannot be written.
pub fn run(arguments: &Arguments) -> Result<(), CommandError> {
    clap_mangen::generate_to(Cli::command(), &arguments.to)?;
    Ok(())
}
