//! A database for one test.

use std::path::Path;
use std::sync::Arc;

use fleetcal_clock::MockClock;
use fleetcal_postgres::{JobRuns, PostgresSetup};
use fleetcal_store::Store;
use fleetcal_store::database_url::PostgresUrl;
use tempfile::TempDir;

/// Names the PostgreSQL server that tests may fill with databases, such as
/// `postgres://fleetcal@127.0.0.1:5432/postgres`.
pub const SERVER: &str = "FLEETCAL_TEST_POSTGRES";

/// The server that [`SERVER`] names.
pub fn server() -> Option<PostgresUrl> {
    let url = std::env::var(SERVER).ok()?;
    Some(url.parse().unwrap())
}

/// A database of its own, which goes with this value where it is a file; the server of the others
/// goes after the tests.
#[derive(Debug)]
pub struct TestDatabase {
    folder: TempDir,
    postgres: Option<PostgresSetup>,
}

impl TestDatabase {
    /// An empty one.
    pub async fn new() -> Self {
        match server() {
            Some(server) => Self::on(&server).await,
            None => Self::in_sqlite(),
        }
    }

    /// An empty one in SQLite.
    pub fn in_sqlite() -> Self {
        Self {
            folder: tempfile::tempdir().unwrap(),
            postgres: None,
        }
    }

    /// An empty one on a server.
    pub async fn on(server: &PostgresUrl) -> Self {
        let url = fleetcal_postgres::create_for_test(server).await.unwrap();
        Self {
            folder: tempfile::tempdir().unwrap(),
            postgres: Some(PostgresSetup {
                url,
                password_file: None,
            }),
        }
    }

    /// A folder of its own.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Where it is, unless it is a file.
    pub fn postgres(&self) -> Option<&PostgresSetup> {
        self.postgres.as_ref()
    }

    /// Opens a store on it.
    pub async fn open(&self, clock: Arc<MockClock>) -> Store {
        match &self.postgres {
            Some(setup) => fleetcal_postgres::open(setup.clone(), Box::new(()), clock as _).await,
            None => fleetcal_sqlite::open(self.folder.path(), clock as _).await,
        }
        .unwrap()
    }

    /// Opens a store that runs each job twice, of which the first run is undone: so every test
    /// shows that its jobs can be run again.
    pub async fn open_running_twice(&self, clock: Arc<MockClock>) -> Store {
        match &self.postgres {
            Some(setup) => {
                let setup = setup.clone();
                fleetcal_postgres::open_with(setup, Box::new(()), clock as _, JobRuns::Twice).await
            }
            None => fleetcal_sqlite::open_running_twice(self.folder.path(), clock as _).await,
        }
        .unwrap()
    }
}
