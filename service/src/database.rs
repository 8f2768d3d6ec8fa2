//! Place of the records, by a command's options: in the data folder, or in PostgreSQL.

use std::path::{Path, PathBuf};

use clap::Args;
use fleetcal_clock::SharedClock;
use fleetcal_config::Config;
use fleetcal_folder::Folder;
use fleetcal_postgres::PostgresSetup;
use fleetcal_store::database_url::{DatabaseUrlRefused, PostgresUrl};
use fleetcal_store::{Administration, Store, StoreError};
use thiserror::Error;

/// Reason for which a command has no database.
#[derive(Debug, Error)]
pub enum DatabaseError {
    /// The URL is refused.
    #[error("--database: {0}")]
    Url(#[from] DatabaseUrlRefused),
    /// Neither a folder nor a PostgreSQL is named.
    #[error("no database is named: give --data DIR or --database URL")]
    NotNamed,
    /// PostgreSQL has its own tools for backups.
    #[error(
        "{0} is not copied by fleetcal: use pg_dump --format=custom, or the backups of its servers"
    )]
    CopiedElsewhere(String),
    /// The database cannot be opened.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// Flags that name a PostgreSQL.
#[derive(Debug, Clone, Default, Args)]
pub struct DatabaseArguments {
    /// PostgreSQL that keeps the records instead of the data folder, such as
    /// <postgres://fleetcal@db1,db2/fleetcal>
    // A text, because clap repeats a value that it refuses, and this one may hold a password.
    #[arg(
        long,
        value_name = "URL",
        env = "FLEETCAL_DATABASE",
        hide_env_values = true
    )]
    database: Option<String>,
    /// File whose first line is the password [default: the file in PGPASSFILE]
    #[arg(long, value_name = "FILE", env = "FLEETCAL_DATABASE_PASSWORD_FILE")]
    database_password_file: Option<PathBuf>,
}

impl DatabaseArguments {
    /// Returns the database that the flags name.
    ///
    /// # Errors
    /// The URL is refused.
    pub fn setup(&self) -> Result<Option<PostgresSetup>, DatabaseUrlRefused> {
        let Some(text) = &self.database else {
            return Ok(None);
        };
        Ok(Some(PostgresSetup {
            url: text.parse::<PostgresUrl>()?,
            password_file: self.database_password_file.clone(),
        }))
    }

    /// Puts the flags into a configuration, where they have precedence.
    ///
    /// # Errors
    /// The URL is refused.
    pub fn put_into(&self, config: &mut Config) -> Result<(), DatabaseUrlRefused> {
        if let Some(setup) = self.setup()? {
            config.database = Some(setup.url);
        }
        if let Some(file) = &self.database_password_file {
            config.database_password_file = Some(file.clone());
        }
        Ok(())
    }
}

/// Place of a service's records, by a command's flags.
#[derive(Debug, Clone, Args)]
pub struct Place {
    /// The service's data folder
    #[arg(long, value_name = "DIR", required_unless_present = "database")]
    data: Option<PathBuf>,
    #[command(flatten)]
    database: DatabaseArguments,
}

impl Place {
    /// Opens the database, also while a service runs on it.
    ///
    /// # Errors
    /// The database is missing or cannot be used.
    pub async fn administration(&self) -> Result<Administration, DatabaseError> {
        Ok(match (self.database.setup()?, &self.data) {
            (Some(setup), _) => fleetcal_postgres::administration(setup).await?,
            (None, Some(data)) => fleetcal_sqlite::administration(data).await?,
            // clap asks for one of them.
            (None, None) => return Err(DatabaseError::NotNamed),
        })
    }

    /// Returns the data folder.
    ///
    /// # Errors
    /// [`DatabaseError::CopiedElsewhere`] if the records are in PostgreSQL.
    pub fn folder(&self) -> Result<&Path, DatabaseError> {
        if let Some(setup) = self.database.setup()? {
            return Err(DatabaseError::CopiedElsewhere(setup.url.to_string()));
        }
        self.data.as_deref().ok_or(DatabaseError::NotNamed)
    }
}

/// Opens the store that a configuration names. The data folder is locked in either case: the
/// signing key is there.
///
/// # Errors
/// The store cannot be opened.
pub async fn open(config: &Config, clock: SharedClock) -> Result<Store, StoreError> {
    let Some(url) = &config.database else {
        return fleetcal_sqlite::open(&config.data, clock).await;
    };
    let held = Folder::hold(&config.data)?;
    if Folder::database_in(&config.data).exists() {
        let folder = config.data.display();
        tracing::warn!(%folder, "the folder holds a database of SQLite, which is not used");
    }
    let setup = PostgresSetup {
        url: url.clone(),
        password_file: config.database_password_file.clone(),
    };
    match config.cluster.instance.clone() {
        Some(instance) => {
            fleetcal_postgres::open_instance(setup, Box::new(held), clock, instance).await
        }
        None => fleetcal_postgres::open(setup, Box::new(held), clock).await,
    }
}
