//! The database of a service under test: SQLite in its folder, or one on a server of PostgreSQL.

use std::fs;
use std::path::{Path, PathBuf};

use fleetcal_contract::server;
use fleetcal_store::database_url::PostgresUrl;

/// Variable that names a service's PostgreSQL.
const VARIABLE: &str = "FLEETCAL_DATABASE";

/// Returns the file beside a data folder that names the database of its service.
fn note(data: &Path) -> PathBuf {
    data.with_extension("database")
}

/// Returns the environment variable of a service or command on this data folder; `None` if its
/// database is in the folder.
pub fn variable(data: &Path) -> Option<(String, String)> {
    let url = fs::read_to_string(note(data)).ok()?;
    Some((VARIABLE.to_owned(), url))
}

/// Names the database of the service on a data folder.
///
/// # Panics
/// When nothing can be written beside the folder.
pub fn name(data: &Path, url: &PostgresUrl) {
    fs::write(note(data), url.to_string()).expect("a note");
}

/// Creates an empty database for a data folder that has none, where tests run on a server.
///
/// # Panics
/// When the server creates none.
pub fn create(data: &Path) {
    let Some(server) = server().filter(|_| !note(data).exists()) else {
        return;
    };
    name(data, &created_on(&server));
}

/// Creates an empty database on a server.
///
/// # Panics
/// When the server creates none.
pub fn created_on(server: &PostgresUrl) -> PostgresUrl {
    let server = server.clone();
    // Of its own thread, because a test may be on a runtime already.
    let create = move || {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .expect("a runtime");
        runtime.block_on(fleetcal_postgres::create_for_test(&server))
    };
    let created = std::thread::spawn(create).join().expect("it ends");
    created.expect("a database")
}
