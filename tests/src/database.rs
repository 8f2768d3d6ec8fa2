//! The database of a service under test: SQLite in its folder, or one on a server of PostgreSQL.

use fleetcal_contract::server;

/// The variable by which a service is told of its PostgreSQL.
const VARIABLE: &str = "FLEETCAL_DATABASE";

/// What a service's environment says of an empty database of its own: nothing where it stands on
/// SQLite.
///
/// # Panics
/// When the server that tests were given creates none.
pub fn variable() -> Option<(String, String)> {
    let server = server()?;
    // Of its own thread, because a test may be on a runtime already.
    let create = move || {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .expect("a runtime");
        runtime.block_on(fleetcal_postgres::create_for_test(&server))
    };
    let created = std::thread::spawn(create).join().expect("it ends");
    let url = created.expect("a database");
    Some((VARIABLE.to_owned(), url.to_string()))
}
