//! `fleetcal restore`: a backup becomes the data folder of a service.

use std::path::PathBuf;

use clap::Args;
use fleetcal_command::output::print_text;

use crate::command::CommandError;

/// Arguments of `fleetcal restore`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The backup, as `fleetcal backup` wrote it
    #[arg(long, value_name = "FILE")]
    pub from: PathBuf,
    /// The data folder to make, or an empty one
    #[arg(long, value_name = "DIR")]
    pub data: PathBuf,
    /// The former folder's `signing.key`, with `signing.key.changes` beside it if there is one; without it agents refuse documents of the restored service
    /// until their `--service-key` names its new key
    #[arg(long, value_name = "FILE")]
    pub signing_key: Option<PathBuf>,
}

/// Checks the backup and copies it.
///
/// # Errors
/// The backup or the key cannot be used, or the folder has a database.
pub async fn run(arguments: &Arguments) -> Result<(), CommandError> {
    let Arguments {
        from,
        data,
        signing_key,
    } = arguments;
    let restored = fleetcal_sqlite::restore(from, signing_key.as_deref(), data).await?;
    let plural = if restored.robots == 1 { "" } else { "s" };
    let key = if restored.has_key {
        ""
    } else {
        "\nThere is no signing.key: at its start the service makes a new one, and agents refuse its \
         documents until their --service-key names it."
    };
    let (robots, data) = (restored.robots, data.display());
    Ok(print_text(&format!(
        "{data}: restored, {robots} robot{plural}{key}\n"
    ))?)
}
