//! `fleetcal backup`: the database as of one moment, in one file.

use std::path::PathBuf;

use clap::Args;

use crate::command::CommandError;
use crate::database::Place;

/// Arguments of `fleetcal backup`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Place of the records
    #[command(flatten)]
    pub place: Place,
    /// The file to write; an existing file is replaced when the new one is complete
    #[arg(long, value_name = "FILE")]
    pub to: PathBuf,
}

/// Copies the database.
///
/// # Errors
/// There is no database, it is in PostgreSQL, or the file cannot be written.
pub async fn run(arguments: &Arguments) -> Result<(), CommandError> {
    fleetcal_sqlite::backup(arguments.place.folder()?, &arguments.to).await?;
    Ok(())
}
