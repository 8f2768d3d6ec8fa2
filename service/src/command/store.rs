//! `fleetcal store`: the database itself, brought up to date or into another.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Subcommand};
use fleetcal_command::output::print_text;
use fleetcal_postgres::PostgresSetup;
use fleetcal_sql::copy::TABLES;
use fleetcal_sqlite::Source;
use indicatif::{ProgressBar, ProgressStyle};

use crate::command::CommandError;
use crate::database::DatabaseArguments;

/// Arguments of `fleetcal store`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The action.
    #[command(subcommand)]
    pub action: Action,
}

/// Actions on a database.
#[derive(Debug, Subcommand)]
pub enum Action {
    /// Migrates a PostgreSQL to this program's schema, for a role that may not do so when it serves
    Migrate(Migrate),
    /// Copies all records of a data folder into an empty PostgreSQL, while no service runs on it
    Copy(Copy),
}

/// Arguments of `fleetcal store copy`.
#[derive(Debug, Args)]
pub struct Copy {
    /// The data folder, such as <sqlite:/var/lib/fleetcal>
    #[arg(long, value_name = "sqlite:DIR", value_parser = sqlite)]
    pub from: PathBuf,
    /// The PostgreSQL, such as <postgres://fleetcal@db/fleetcal>
    // A text, because clap repeats a value that it refuses, and this one may hold a password.
    #[arg(long, value_name = "URL")]
    to: String,
    /// File whose first line is its password [default: the file in PGPASSFILE]
    #[arg(long, value_name = "FILE", env = "FLEETCAL_DATABASE_PASSWORD_FILE")]
    database_password_file: Option<PathBuf>,
}

/// Parses the folder of `sqlite:DIR`.
fn sqlite(text: &str) -> Result<PathBuf, String> {
    let folder = text.strip_prefix("sqlite:").filter(|dir| !dir.is_empty());
    let refused = || format!("got {text:?}, expected sqlite:DIR");
    folder.map(PathBuf::from).ok_or_else(refused)
}

/// Arguments of `fleetcal store migrate`.
#[derive(Debug, Args)]
pub struct Migrate {
    #[command(flatten)]
    database: DatabaseArguments,
    /// Role that `fleetcal serve` signs in as: it gets the rights it needs, and may change neither
    /// tables nor the audit
    #[arg(long, value_name = "ROLE")]
    serve_as: Option<String>,
}

/// Runs the action.
///
/// # Errors
/// The database cannot be reached or changed.
pub async fn run(arguments: &Arguments) -> Result<(), CommandError> {
    match &arguments.action {
        Action::Migrate(migrate) => self::migrate(migrate).await,
        Action::Copy(copy) => self::copy(copy).await,
    }
}

async fn migrate(arguments: &Migrate) -> Result<(), CommandError> {
    let setup = arguments.database.setup()?;
    let setup = setup.ok_or(CommandError::NoPostgres)?;
    let name = setup.url.to_string();
    fleetcal_postgres::migrate(setup, arguments.serve_as.as_deref()).await?;
    Ok(print_text(&format!("{name}: the schema is up to date\n"))?)
}

async fn copy(arguments: &Copy) -> Result<(), CommandError> {
    let setup = PostgresSetup {
        url: arguments.to.parse().map_err(CommandError::CopyTo)?,
        password_file: arguments.database_password_file.clone(),
    };
    let name = setup.url.to_string();
    let mut from = Source::open(&arguments.from).await?;
    let mut rows = 0;
    for table in TABLES.iter() {
        rows += table.count(&mut from).await?;
    }
    let bar = progress(rows);
    let contents = fleetcal_postgres::copy(&mut from, setup, &|more| bar.inc(more)).await?;
    bar.finish_and_clear();
    let took_s = bar.elapsed().as_secs_f64();
    let tables: Vec<String> = contents
        .iter()
        .map(|(table, content)| {
            let table = table.trim_matches('"');
            format!("{:>10}  {}  {table}", content.rows, content.sha256)
        })
        .collect();
    Ok(print_text(&format!(
        "{:>10}  {:<64}  TABLE\n{}\n{name}: copied {rows} rows in {took_s:.1} s, read again and \
         found equal\n",
        "ROWS",
        "SHA-256",
        tables.join("\n")
    ))?)
}

/// Makes a bar on standard error, for people alone.
fn progress(rows: u64) -> ProgressBar {
    let bar = ProgressBar::new(rows);
    let style =
        ProgressStyle::with_template("{wide_bar} {human_pos} of {human_len} rows, {eta} left");
    if let Ok(style) = style {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}
