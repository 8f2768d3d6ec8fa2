//! Databases for tests.

use std::sync::atomic::{AtomicU32, Ordering};

use fleetcal_sql::{Connection as _, Statement};
use fleetcal_store::StoreError;
use fleetcal_store::database_url::PostgresUrl;

use crate::PostgresSetup;
use crate::connection::Session;
use crate::servers::{Purpose, Servers};

/// Creates an empty database on a server; gives its URL.
///
/// # Errors
/// As of connecting; [`StoreError::Database`] when it cannot be created.
pub async fn create_for_test(server: &PostgresUrl) -> Result<PostgresUrl, StoreError> {
    static CREATED: AtomicU32 = AtomicU32::new(0);
    let number = CREATED.fetch_add(1, Ordering::Relaxed);
    let name = format!("fleetcal_{}_{number}", std::process::id());
    let servers = Servers::new(PostgresSetup {
        url: server.clone(),
        password_file: None,
    })?;
    let mut session = Session::new(servers.connect(Purpose::Migration).await?);
    run_for_test(&mut session, format!("DROP DATABASE IF EXISTS {name}")).await?;
    run_for_test(
        &mut session,
        format!("CREATE DATABASE {name} STRATEGY file_copy"),
    )
    .await?;
    session.close().await;
    Ok(PostgresUrl {
        database: name,
        ..server.clone()
    })
}

/// Runs a statement that only a test has.
async fn run_for_test(session: &mut Session, sql: String) -> Result<(), StoreError> {
    let statement = Statement {
        sql: sql.into(),
        values: Vec::new(),
    };
    let done = session.execute(statement).await;
    done.map(drop)
        .map_err(StoreError::database("do what a test asks"))
}
