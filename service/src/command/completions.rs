//! `fleetcal completions`: what a shell needs to complete the command's flags.

use clap::{Args, CommandFactory};
use clap_complete::Shell;
use fleetcal_command::output::print_text;

use crate::command::{Cli, CommandError};

/// Arguments of `fleetcal completions`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The shell
    #[arg(value_enum)]
    pub shell: Shell,
}

/// Prints the script.
///
/// # Errors
/// The standard output cannot be written.
pub fn run(arguments: &Arguments) -> Result<(), CommandError> {
    let mut script = Vec::new();
    clap_complete::generate(
        arguments.shell,
        &mut Cli::command(),
        "fleetcal",
        &mut script,
    );
    Ok(print_text(&String::from_utf8_lossy(&script))?)
}
