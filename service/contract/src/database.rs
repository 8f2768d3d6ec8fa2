//! A database for one test.

use std::path::PathBuf;
use std::sync::Arc;

use fleetcal_clock::{Clock, SharedClock};
use fleetcal_postgres::{JobRuns, PostgresSetup, Sharing};
use fleetcal_store::database_url::PostgresUrl;
use fleetcal_store::{Store, StoreError};
use tempfile::TempDir;

/// Variable with the PostgreSQL server that tests may fill with databases, such as
/// `postgres://fleetcal@127.0.0.1:5432/postgres`.
pub const SERVER: &str = "FLEETCAL_TEST_POSTGRES";

/// Returns the server that [`SERVER`] names.
pub fn server() -> Option<PostgresUrl> {
    let url = std::env::var(SERVER).ok()?;
    Some(url.parse().unwrap())
}

/// A database of one test. A file is removed with this value; the others are removed with their
/// server after the tests.
#[derive(Debug)]
pub struct TestDatabase {
    place: Place,
    /// Folder that is removed with this value.
    _folder: Option<TempDir>,
}

/// Place of a database.
#[derive(Debug)]
enum Place {
    Folder(PathBuf),
    Server(PostgresSetup),
}

impl TestDatabase {
    /// Makes an empty database.
    pub async fn new() -> Self {
        match server() {
            Some(server) => Self::on(&server).await,
            None => Self::in_sqlite(),
        }
    }

    /// Makes an empty database in SQLite.
    pub fn in_sqlite() -> Self {
        let folder = tempfile::tempdir().unwrap();
        Self {
            place: Place::Folder(folder.path().to_owned()),
            _folder: Some(folder),
        }
    }

    /// Makes an empty database on a server.
    pub async fn on(server: &PostgresUrl) -> Self {
        let url = fleetcal_postgres::create_for_test(server).await.unwrap();
        Self::at(&url.to_string())
    }

    /// Returns a database that another process has made, by its address.
    pub fn at(address: &str) -> Self {
        let place = match address.parse() {
            Ok(url) => Place::Server(PostgresSetup {
                url,
                password_file: None,
            }),
            Err(_) => Place::Folder(PathBuf::from(address)),
        };
        Self {
            place,
            _folder: None,
        }
    }

    /// Returns the address by which another process finds it.
    pub fn address(&self) -> String {
        match &self.place {
            Place::Folder(path) => path.display().to_string(),
            Place::Server(setup) => setup.url.to_string(),
        }
    }

    /// Returns its server, unless it is a file.
    pub fn postgres(&self) -> Option<&PostgresSetup> {
        match &self.place {
            Place::Folder(_) => None,
            Place::Server(setup) => Some(setup),
        }
    }

    /// Runs statements on it, as another program would; only in SQLite.
    pub async fn execute(&self, sql: &str) {
        let Place::Folder(path) = &self.place else {
            panic!("statements of a test are in SQLite's words");
        };
        fleetcal_sqlite::execute_for_test(path, sql).await.unwrap();
    }

    /// Opens a store on it, beside others where it is on a server.
    pub async fn open(&self, clock: Arc<impl Clock>) -> Store {
        match &self.place {
            Place::Server(setup) => {
                open_beside_others(setup, clock as SharedClock, JobRuns::Once).await
            }
            Place::Folder(path) => fleetcal_sqlite::open(path, clock as SharedClock).await,
        }
        .unwrap()
    }

    /// Opens a store that runs each job twice, with the first run undone: so every test shows that
    /// its jobs can be repeated.
    pub async fn open_running_twice(&self, clock: Arc<impl Clock>) -> Store {
        match &self.place {
            Place::Server(setup) => {
                open_beside_others(setup, clock as SharedClock, JobRuns::Twice).await
            }
            Place::Folder(path) => {
                fleetcal_sqlite::open_running_twice(path, clock as SharedClock).await
            }
        }
        .unwrap()
    }
}

/// Opens a store on a database that others may have open.
async fn open_beside_others(
    setup: &PostgresSetup,
    clock: SharedClock,
    jobs: JobRuns,
) -> Result<Store, StoreError> {
    let sharing = Sharing::WithOthers;
    fleetcal_postgres::open_with(setup.clone(), Box::new(()), clock, jobs, sharing).await
}
