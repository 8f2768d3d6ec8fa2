//! Databases for tests.

use std::sync::atomic::{AtomicU32, Ordering};

use fleetcal_domain::limits;
use fleetcal_sql::{Connection as _, Statement};
use fleetcal_store::StoreError;
use fleetcal_store::database_url::PostgresUrl;

use crate::PostgresSetup;
use crate::connection::Session;
use crate::history;
use crate::servers::{Purpose, Servers};

/// Creates an empty database on a server; returns its URL.
///
/// # Errors
/// Errors of connecting; [`StoreError::Database`] if it cannot be created.
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
    run_for_test(&mut session, format!("CREATE DATABASE {name}")).await?;
    session.close().await;
    Ok(PostgresUrl {
        database: name,
        ..server.clone()
    })
}

/// Runs a statement that only tests need.
async fn run_for_test(session: &mut Session, sql: String) -> Result<(), StoreError> {
    // A busy machine takes seconds to create a database.
    let done = session.run_within(limits::POSTGRES_BULK_TIMEOUT, sql).await;
    done.map_err(StoreError::database("do what a test asks"))
}

/// Returns the server process of `setup`, which is on this machine, and the bytes of write-ahead
/// log that it has written since it was created.
///
/// # Errors
/// Errors of connecting; [`StoreError::Database`] if the process is not on this machine.
pub async fn spent_for_test(setup: &PostgresSetup) -> Result<(u32, f64), StoreError> {
    let servers = Servers::new(setup.clone())?;
    let mut session = Session::new(servers.connect(Purpose::Migration).await?);
    let asked = Statement {
        sql: "SELECT pg_backend_pid()::int8, pg_wal_lsn_diff(pg_current_wal_lsn(), '0/0')::int8"
            .into(),
        values: Vec::new(),
    };
    let failed = || StoreError::database("say what it has spent");
    let rows = session.rows(asked).await.map_err(failed())?;
    let number = |index| rows.first().and_then(|row| row.integer(index)).unwrap_or(0);
    // The parent of a connection's process is the server.
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", number(0)));
    let stat = stat.map_err(StoreError::database("say which process it is"))?;
    let parent = stat
        .rsplit_once(") ")
        .and_then(|(_, rest)| rest.split(' ').nth(1));
    session.close().await;
    let parent = parent.and_then(|text| text.parse().ok()).unwrap_or(0);
    Ok((parent, number(1) as f64))
}

/// Fills a day of the history, by message time and receipt, with the seconds of robots that drove
/// all day, in the order of their arrival.
///
/// # Errors
/// Errors of connecting; [`StoreError::Database`].
pub async fn fill_day_for_test(
    setup: &PostgresSetup,
    day: i64,
    robots: i64,
) -> Result<(), StoreError> {
    const MINUTES: i64 = 24 * 60;
    let servers = Servers::new(setup.clone())?;
    let mut session = Session::new(servers.connect(Purpose::Telemetry).await?);
    history::add_day(&mut session, day).await?;
    for minute in 0..MINUTES {
        let from_s = day * history::DAY_S + minute * 60;
        let filled = format!(
            "INSERT INTO history_second SELECT r, {from_s} + s, {from_s} + s,
                 random(), random(), random(), random(), random(), random(), random(), random(),
                 random(), random(), NULL, NULL, random(), random(), NULL, NULL, 7, random()
             FROM generate_series(0, 59) AS s, generate_series(1, {robots}) AS r"
        );
        run_for_test(&mut session, filled).await?;
    }
    let noted = format!(
        "UPDATE history_day SET received = (day + 1) * 86400 - 1, row_count = 86400 * {robots}
         WHERE day = {day}"
    );
    run_for_test(&mut session, noted).await?;
    session.close().await;
    Ok(())
}
