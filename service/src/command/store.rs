//! `fleetcal store`: the database itself, brought up to date.

use clap::{Args, Subcommand};
use fleetcal_command::output::print_text;

use crate::command::CommandError;
use crate::database::DatabaseArguments;

/// What `fleetcal store` takes.
#[derive(Debug, Args)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub action: Action,
}

/// What is done with a database.
#[derive(Debug, Subcommand)]
pub enum Action {
    /// Brings a PostgreSQL to this program's schema, for a role that may not do so when it serves
    Migrate(Migrate),
}

/// What `fleetcal store migrate` takes.
#[derive(Debug, Args)]
pub struct Migrate {
    #[command(flatten)]
    database: DatabaseArguments,
    /// Role that `fleetcal serve` signs in as: it is granted what it needs, and may neither change
    /// tables nor the audit
    #[arg(long, value_name = "ROLE")]
    serve_as: Option<String>,
}

/// Does what was asked for.
///
/// # Errors
/// When the database cannot be reached or changed.
pub async fn run(arguments: &Arguments) -> Result<(), CommandError> {
    match &arguments.action {
        Action::Migrate(migrate) => self::migrate(migrate).await,
    }
}

async fn migrate(arguments: &Migrate) -> Result<(), CommandError> {
    let setup = arguments.database.setup()?;
    let setup = setup.ok_or(CommandError::NoPostgres)?;
    let name = setup.url.to_string();
    fleetcal_postgres::migrate(setup, arguments.serve_as.as_deref()).await?;
    Ok(print_text(&format!("{name}: the schema is up to date\n"))?)
}
