//! `fleetcal backup`: the database as of one moment, in one file.

use std::path::PathBuf;

use clap::Args;

use crate::command::CommandError;

/// What `fleetcal backup` takes.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The service's data folder
    #[arg(long, value_name = "DIR")]
    pub data: PathBuf,
    /// The file to write; an existing file is replaced when the new one is complete
    #[arg(long, value_name = "FILE")]
    pub to: PathBuf,
}

/// Copies the database.
///
/// # Errors
/// When there is none, or the file cannot be written.
pub async fn run(arguments: &Arguments) -> Result<(), CommandError> {
    fleetcal_sqlite::backup(&arguments.data, &arguments.to).await?;
    Ok(())
}
