//! The schema: brought up to date by the first process that may, never back. A program goes on with
//! a newer schema whose migration says that it may.

use std::path::PathBuf;
use std::sync::Arc;

use fleetcal_domain::limits;
use fleetcal_sql::{Connection as _, Statement, Value, schema_version};
use fleetcal_store::StoreError;
use sqlx::migrate::{MigrateError, Migrator};
use sqlx::postgres::PgConnection;

use crate::PostgresSetup;
use crate::connection::Session;
use crate::failure::{TimedOut, state};
use crate::servers::{Purpose, Servers};

static MIGRATIONS: Migrator = sqlx::migrate!("../../migrations/postgres");

/// Returns the newest migration in this program.
pub(crate) fn known() -> i64 {
    let versions = MIGRATIONS.iter().map(|migration| migration.version);
    versions.max().unwrap_or(0)
}

/// Returns the newest migration of the database; `None` if it has no table of ours.
pub(crate) async fn found(session: &mut Session) -> Result<Option<i64>, StoreError> {
    let asked = Statement {
        sql: "SELECT to_regclass('_sqlx_migrations') IS NOT NULL".into(),
        values: Vec::new(),
    };
    let rows = session.rows(asked).await;
    let rows = rows.map_err(StoreError::database("look for its tables"))?;
    let is_there = rows.first().and_then(|row| row.0.first());
    if is_there != Some(&Value::Boolean(Some(true))) {
        return Ok(None);
    }
    schema_version(session).await.map(Some)
}

/// True if this program may use a database whose newest migration is `found`.
pub(crate) async fn may_use(session: &mut Session, found: i64) -> Result<bool, StoreError> {
    if found <= known() {
        return Ok(found == known());
    }
    let asked = Statement {
        sql: "SELECT oldest FROM schema_compatible WHERE version = $1".into(),
        values: vec![found.into()],
    };
    let rows = session.rows(asked).await;
    let rows = rows.map_err(StoreError::database("read who may use its schema"))?;
    let oldest = rows.first().and_then(|row| row.0.first());
    Ok(matches!(oldest, Some(Value::Integer(Some(oldest))) if *oldest <= known()))
}

/// Migrates the database to this program's schema, unless it has one that this program may use: so
/// a role that may not change tables can serve a database that another role has migrated. Returns
/// its newest migration.
///
/// # Errors
/// [`StoreError::NewerSchema`], [`StoreError::Migration`], or an error of connecting.
pub(crate) async fn bring(servers: &Servers) -> Result<i64, StoreError> {
    let mut session = Session::new(servers.connect(Purpose::Records).await?);
    let found = found(&mut session).await?.unwrap_or(0);
    let may_use = may_use(&mut session, found).await?;
    session.close().await;
    if may_use {
        return Ok(found);
    }
    if found > known() {
        return Err(newer(servers, found));
    }
    run(servers).await.map(|_| known())
}

/// Migrates the database of `setup` to this program's schema and lets the role `serve_as` use it.
///
/// # Errors
/// Errors of opening it; [`StoreError::Server`] if the server has no role `serve_as`.
pub async fn migrate(setup: PostgresSetup, serve_as: Option<&str>) -> Result<(), StoreError> {
    let servers = Servers::new(setup)?;
    let connection = run(&servers).await?;
    let mut session = Session::new(connection);
    if let Some(role) = serve_as {
        grant(&servers, &mut session, role).await?;
    }
    session.close().await;
    Ok(())
}

/// Runs the migrations. Two processes that start at once alternate: sqlx holds an advisory lock.
async fn run(servers: &Servers) -> Result<PgConnection, StoreError> {
    let mut connection = servers.connect(Purpose::Migration).await?;
    let migrating = MIGRATIONS.run_direct(None, &mut connection, false);
    let migrated = tokio::time::timeout(limits::POSTGRES_BULK_TIMEOUT, migrating).await;
    match migrated.unwrap_or_else(|_| Err(MigrateError::Execute(late()))) {
        Ok(()) => Ok(connection),
        Err(MigrateError::VersionMissing(found)) => Err(newer(servers, found)),
        Err(error) if may_not(&error) => Err(StoreError::Server {
            database: servers.name(),
            reason: format!(
                "needs a schema that the role {:?} may not make: let a role that may bring the \
                 database to it, or grant CREATE on the schema public",
                servers.user()
            ),
        }),
        Err(error) => Err(StoreError::Migration(Arc::new(error))),
    }
}

/// Makes the error of migrations that exceeded their time limit.
fn late() -> sqlx::Error {
    let seconds = limits::POSTGRES_BULK_TIMEOUT.as_secs_f32();
    sqlx::Error::Io(std::io::Error::other(TimedOut { seconds }))
}

/// True if the role lacks the rights.
fn may_not(error: &MigrateError) -> bool {
    let (MigrateError::Execute(error) | MigrateError::ExecuteMigration(error, _)) = error else {
        return false;
    };
    let told = error.as_database_error();
    told.is_some_and(|told| told.code().as_deref() == Some(state::INSUFFICIENT_PRIVILEGE))
}

fn newer(servers: &Servers, found: i64) -> StoreError {
    StoreError::NewerSchema {
        path: PathBuf::from(servers.name()),
        found,
        known: known(),
    }
}

/// Grants the serving role its rights: read and write rows, but change neither tables nor the
/// audit.
async fn grant(servers: &Servers, session: &mut Session, role: &str) -> Result<(), StoreError> {
    let refused = |reason: String| StoreError::Server {
        database: servers.name(),
        reason,
    };
    // Only the server can quote a name for itself.
    let quoted = Statement {
        sql: "SELECT quote_ident(rolname) FROM pg_roles WHERE rolname = $1".into(),
        values: vec![role.into()],
    };
    let rows = session.rows(quoted).await;
    let rows = rows.map_err(StoreError::database("look for a role"))?;
    let Some(Value::Text(Some(role))) = rows
        .into_iter()
        .next()
        .and_then(|row| row.0.into_iter().next())
    else {
        return Err(refused(format!(
            "has no role {role:?}; `CREATE ROLE` makes one"
        )));
    };
    for sql in [
        format!("GRANT SELECT, INSERT, UPDATE, DELETE ON ALL TABLES IN SCHEMA public TO {role}"),
        format!("GRANT USAGE ON ALL SEQUENCES IN SCHEMA public TO {role}"),
        format!(
            "GRANT EXECUTE ON FUNCTION history_add_day(bigint), history_drop_days(bigint) TO {role}"
        ),
        format!("REVOKE UPDATE, DELETE ON audit, revision FROM {role}"),
        format!("REVOKE UPDATE ON envelope, certificate FROM {role}"),
        format!("REVOKE INSERT, UPDATE, DELETE ON _sqlx_migrations, schema_compatible FROM {role}"),
    ] {
        let statement = Statement {
            sql: sql.into(),
            values: Vec::new(),
        };
        let granted = session.execute(statement).await;
        granted.map_err(StoreError::database("grant a role its rights"))?;
    }
    Ok(())
}
