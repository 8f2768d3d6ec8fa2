//! `fleetcal check-config`: whether the service would accept a configuration, before it is used.

use std::path::PathBuf;

use clap::Args;
use fleetcal_command::output::print_text;
use fleetcal_config::Config;

use crate::command::CommandError;

/// Arguments of `fleetcal check-config`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The `fleetcal.toml`
    #[arg(value_name = "FILE")]
    pub config: PathBuf,
}

/// Reads the configuration as `fleetcal serve --config` does, and prints a summary of it.
///
/// # Errors
/// The configuration cannot be read or is refused: the line, the key, and the accepted values.
pub fn run(arguments: &Arguments) -> Result<(), CommandError> {
    let config = Config::read(&arguments.config)?;
    let robots = config.robots.len();
    let plural = if robots == 1 { "" } else { "s" };
    let database = config.database.as_ref();
    let database = database.map_or_else(String::new, |url| format!(", records in {url}"));
    Ok(print_text(&format!(
        "{}: valid, {robots} robot{plural} configured; HTTP on {}, data in {}{database}\n",
        arguments.config.display(),
        config.http,
        config.data.display(),
    ))?)
}
