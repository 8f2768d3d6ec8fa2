//! Place of a test's database: in a folder, or in a PostgreSQL.

use std::path::PathBuf;

use fleetcal_clock::SharedClock;
use fleetcal_postgres::PostgresSetup;
use fleetcal_sqlite::Outlives;
use fleetcal_store::{Store, StoreError};

/// Place of a database.
#[derive(Debug, Clone)]
pub enum Place {
    Folder(PathBuf),
    Server(PostgresSetup),
}

impl Place {
    /// Returns the place of an address: the URL of a PostgreSQL, or a folder.
    pub fn of(address: &str) -> Self {
        match address.parse() {
            Ok(url) => Self::Server(PostgresSetup {
                url,
                password_file: None,
            }),
            Err(_) => Self::Folder(PathBuf::from(address)),
        }
    }

    /// Opens the store as the service does. `outlives` applies to a folder: a PostgreSQL has
    /// settings of its own.
    pub async fn open(&self, clock: SharedClock, outlives: Outlives) -> Result<Store, StoreError> {
        match self {
            Self::Folder(folder) => fleetcal_sqlite::open_with(folder, clock, outlives).await,
            Self::Server(setup) => {
                fleetcal_postgres::open(setup.clone(), Box::new(()), clock).await
            }
        }
    }
}
