//! A database for one test.

use std::path::PathBuf;
use std::sync::Arc;

use fleetcal_clock::{Clock, SharedClock};
use fleetcal_postgres::{JobRuns, PostgresSetup, Sharing};
use fleetcal_store::database_url::PostgresUrl;
use fleetcal_store::{Store, StoreError};
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
    place: Place,
    /// Goes with this value.
    _folder: Option<TempDir>,
}

/// Where a database is.
#[derive(Debug)]
enum Place {
    Folder(PathBuf),
    Server(PostgresSetup),
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
        let folder = tempfile::tempdir().unwrap();
        Self {
            place: Place::Folder(folder.path().to_owned()),
            _folder: Some(folder),
        }
    }

    /// An empty one on a server.
    pub async fn on(server: &PostgresUrl) -> Self {
        let url = fleetcal_postgres::create_for_test(server).await.unwrap();
        Self::at(&url.to_string())
    }

    /// One that another process has made, by its address.
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

    /// What another process finds it by.
    pub fn address(&self) -> String {
        match &self.place {
            Place::Folder(path) => path.display().to_string(),
            Place::Server(setup) => setup.url.to_string(),
        }
    }

    /// Where it is, unless it is a file.
    pub fn postgres(&self) -> Option<&PostgresSetup> {
        match &self.place {
            Place::Folder(_) => None,
            Place::Server(setup) => Some(setup),
        }
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

    /// Opens a store that runs each job twice, of which the first run is undone: so every test
    /// shows that its jobs can be run again.
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
