//! The servers that a database may be on, and connections to the one that can be written.

use std::collections::BTreeMap;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use fleetcal_domain::limits;
use fleetcal_store::StoreError;
use fleetcal_store::database_url::{PostgresUrl, Server, TlsMode};
use sqlx::postgres::{PgConnectOptions, PgConnection, PgPool, PgPoolOptions, PgSslMode};
use sqlx::{AssertSqlSafe, ConnectOptions as _, Executor as _, Row as _};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::Instant;

use crate::PostgresSetup;
use crate::connection::{ReadPool, Session, in_time, in_time_of};
use crate::failure::Unusable;

/// Oldest supported PostgreSQL, as its `server_version_num`.
const VERSION_MIN: i32 = 150_000;

/// Time for which the database counts as away after a failed attempt; telemetry makes one each
/// second.
const AWAY_FOR: Duration = limits::POSTGRES_CONNECT_TIMEOUT.saturating_mul(2);

/// Settings by which a client whose machine is lost in the middle of a statement holds its locks
/// for five seconds at most, less than a lease lasts: while the server waits for the rest of a
/// statement, its time limit does not run.
const LOST_CLIENT: &str = "SET client_connection_check_interval = '2s'; SET tcp_keepalives_idle = 2; \
     SET tcp_keepalives_interval = 1; SET tcp_keepalives_count = 3; SET tcp_user_timeout = '4s'";

/// Purpose of a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// Jobs. The server has no time limit: a commit that is cancelled there may have succeeded.
    Records,
    /// Telemetry. A commit waits for the server's disk but not for a standby: a loss of the machine
    /// costs a second.
    Telemetry,
    /// An instance's lease: a loss of the machine makes it shorter.
    Lease,
    /// Ownership of robots. A commit waits for the disk, since an epoch must never be assigned
    /// twice, but not for a standby: a promotion raises the next epoch by itself.
    Ownership,
    /// Dropping old days. The wait for their readers is short, since others wait behind.
    Retention,
    /// Counting attempts to sign in over all instances.
    Tries,
    /// Reading.
    Reading,
    /// Migrating the schema.
    Migration,
}

impl Purpose {
    /// Returns the time limit of a statement.
    const fn within(self) -> Duration {
        match self {
            Self::Lease | Self::Ownership | Self::Tries => limits::CLUSTER_STATEMENT_TIMEOUT,
            _ => limits::POSTGRES_STATEMENT_TIMEOUT,
        }
    }

    /// Returns the settings of a new connection.
    fn settings(self) -> String {
        let lost_client = if self.locks_rows() { LOST_CLIENT } else { "" };
        format!("{}; {lost_client}", self.own_settings())
    }

    /// True if others wait for locks of its transactions.
    const fn locks_rows(self) -> bool {
        matches!(
            self,
            Self::Records | Self::Telemetry | Self::Lease | Self::Ownership | Self::Tries
        )
    }

    /// Returns the settings besides [`LOST_CLIENT`].
    const fn own_settings(self) -> &'static str {
        match self {
            Self::Records => {
                "SET lock_timeout = '2s'; SET idle_in_transaction_session_timeout = '5s'"
            }
            // What a server that died at once had acknowledged is not written again: so it waits for the
            // server's own disk, though for no standby.
            Self::Telemetry => {
                "SET synchronous_commit = local; SET statement_timeout = '10s'; \
                 SET lock_timeout = '2s'; SET idle_in_transaction_session_timeout = '2s'"
            }
            Self::Lease => {
                "SET synchronous_commit = off; SET statement_timeout = '2s'; \
                 SET lock_timeout = '1s'; SET idle_in_transaction_session_timeout = '2s'"
            }
            Self::Ownership => {
                "SET synchronous_commit = local; SET statement_timeout = '2s'; \
                 SET lock_timeout = '1s'; SET idle_in_transaction_session_timeout = '2s'"
            }
            Self::Tries => {
                "SET synchronous_commit = off; SET lock_timeout = '1s'; \
                 SET idle_in_transaction_session_timeout = '2s'"
            }
            Self::Retention => "SET synchronous_commit = off; SET lock_timeout = '100ms'",
            Self::Reading => {
                "SET default_transaction_read_only = on; SET statement_timeout = '10s'; \
                 SET client_connection_check_interval = '2s'"
            }
            // What is there already is no news.
            Self::Migration => "SET lock_timeout = '10s'; SET client_min_messages = warning",
        }
    }
}

/// The servers, and the index of the one that was writable last.
#[derive(Debug)]
pub(crate) struct Servers {
    url: PostgresUrl,
    /// Options in the order of the URL.
    options: Vec<PgConnectOptions>,
    current: AtomicUsize,
    readers: OnceLock<PgPool>,
    /// Time until which the database counts as away.
    away_until: watch::Sender<Option<Instant>>,
}

impl Servers {
    /// Reads the password and makes the options.
    ///
    /// # Errors
    /// [`StoreError::Server`] if its file cannot be read.
    pub(crate) fn new(setup: PostgresSetup) -> Result<Self, StoreError> {
        let PostgresSetup { url, password_file } = setup;
        let unreadable = |reason: String| StoreError::Server {
            database: url.to_string(),
            reason,
        };
        let password = match &password_file {
            Some(path) => {
                let text = std::fs::read_to_string(path).map_err(|error| {
                    unreadable(format!("needs the password of {}: {error}", path.display()))
                })?;
                Some(text.lines().next().unwrap_or_default().to_owned())
            }
            None => None,
        };
        let options = url.servers.iter();
        let options = options.map(|server| options_of(&url, server, password.as_deref()));
        let options = options.collect::<Result<_, _>>().map_err(unreadable)?;
        Ok(Self {
            url,
            options,
            current: AtomicUsize::new(0),
            readers: OnceLock::new(),
            away_until: watch::Sender::new(None),
        })
    }

    /// Returns the address of the database, without a password.
    pub(crate) fn name(&self) -> String {
        self.url.to_string()
    }

    /// Returns the role that signs in.
    pub(crate) fn user(&self) -> &str {
        &self.url.user
    }

    /// Connects to the writable server. The last writable one is tried first, and each further one
    /// a moment later or after a refusal: so a server that never answers does not delay the next.
    ///
    /// # Errors
    /// [`StoreError::Server`], with the reason for each server.
    pub(crate) async fn connect(&self, purpose: Purpose) -> Result<PgConnection, StoreError> {
        let count = self.options.len();
        let first = self.current.load(Ordering::Relaxed);
        let mut order = (0..count).map(|step| (first + step) % count);
        let mut asked = JoinSet::new();
        let mut reasons = BTreeMap::new();
        loop {
            if let Some(index) = order.next() {
                let options = self.options[index].clone();
                asked.spawn(async move { (index, connect_to(&options, purpose).await) });
            } else if asked.is_empty() {
                break;
            }
            let answer = tokio::select! {
                answer = asked.join_next() => answer,
                () = tokio::time::sleep(limits::POSTGRES_NEXT_HOST_AFTER), if order.len() > 0 => None,
            };
            match answer {
                Some(Ok((index, Ok(connection)))) => {
                    self.found(index);
                    self.away_until.send_replace(None);
                    return Ok(connection);
                }
                Some(Ok((index, Err(reason)))) => {
                    reasons.insert(index, format!("{} {reason}", self.url.servers[index]));
                }
                // A task that panicked has said so in the log.
                Some(Err(_)) | None => {}
            }
        }
        let reasons: Vec<String> = reasons.into_values().collect();
        self.away_until
            .send_replace(Some(Instant::now() + AWAY_FOR));
        Err(StoreError::Server {
            database: self.name(),
            reason: format!("cannot be used: {}", reasons.join("; ")),
        })
    }

    /// Connects as [`Self::connect`] and makes a session.
    ///
    /// # Errors
    /// Errors of [`Self::connect`].
    pub(crate) async fn session(&self, purpose: Purpose) -> Result<Session, StoreError> {
        let connection = self.connect(purpose).await?;
        Ok(Session::within(purpose.within(), connection))
    }

    /// Records the writable server; readers connect to it from now on.
    fn found(&self, index: usize) {
        if self.current.swap(index, Ordering::Relaxed) != index {
            tracing::warn!(server = %self.url.servers[index], "another server can be written now");
            if let Some(readers) = self.readers.get() {
                readers.set_connect_options(self.options[index].clone());
            }
        }
    }

    /// Makes connections that read from the writable server, since a standby lags behind it.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub(crate) async fn read_pool(&self) -> Result<ReadPool, StoreError> {
        let settings = Purpose::Reading.own_settings();
        let several = self.options.len() > 1;
        let pool = PgPoolOptions::new()
            .max_connections(limits::STORE_READERS_MAX)
            .acquire_timeout(limits::STORE_READ_TIMEOUT)
            .test_before_acquire(!several)
            .after_connect(move |connection, _| {
                Box::pin(async move { connection.execute(settings).await.map(drop) })
            })
            .before_acquire(move |connection, _| {
                Box::pin(async move {
                    // After a failover a connection to the former primary reads what was.
                    Ok(!several || in_time(is_writable(connection)).await?)
                })
            })
            .connect_with(self.options[self.current.load(Ordering::Relaxed)].clone())
            .await
            .map_err(StoreError::database("be opened for reading"))?;
        let pool = self.readers.get_or_init(|| pool);
        Ok(ReadPool {
            pool: pool.clone(),
            away_until: self.away_until.subscribe(),
        })
    }

    /// Writes over a connection of its own, to test whether the database accepts writes at all.
    ///
    /// # Errors
    /// [`StoreError`] of connecting, or [`StoreError::Database`].
    pub(crate) async fn write_once(&self) -> Result<(), StoreError> {
        let mut session = Session::new(self.connect(Purpose::Records).await?);
        let written = session
            .run("UPDATE probe SET written_ns = written_ns")
            .await
            .map_err(StoreError::database("write at all"));
        session.close().await;
        written
    }
}

/// Connects to a server, if it is writable; the reason for a refusal is a clause behind its name.
async fn connect_to(options: &PgConnectOptions, purpose: Purpose) -> Result<PgConnection, String> {
    let unusable = |error: sqlx::Error| Unusable(&error).to_string();
    let connecting = async {
        let mut connection = options.connect().await?;
        connection
            .execute(AssertSqlSafe(purpose.settings()))
            .await?;
        let asked = "SELECT current_setting('server_version_num')::int4, pg_is_in_recovery()";
        let row = sqlx::query(asked).fetch_one(&mut connection).await?;
        Ok((connection, row))
    };
    let connected = in_time_of(limits::POSTGRES_CONNECT_TIMEOUT, connecting).await;
    let (connection, row) = connected.map_err(unusable)?;
    let version: i32 = row.try_get(0).map_err(unusable)?;
    let is_standby: bool = row.try_get(1).map_err(unusable)?;
    match unsuited(version, is_standby) {
        Some(reason) => Err(reason),
        None => Ok(connection),
    }
}

/// Returns the reason for which a server of this `server_version_num` is unusable, as a clause
/// behind its name.
fn unsuited(version: i32, is_standby: bool) -> Option<String> {
    let (found, expected) = (version / 10_000, VERSION_MIN / 10_000);
    if version < VERSION_MIN {
        Some(format!(
            "is PostgreSQL {found}, expected {expected} or newer"
        ))
    } else if is_standby {
        Some("is a standby, which cannot be written".to_owned())
    } else {
        None
    }
}

async fn is_writable(connection: &mut PgConnection) -> Result<bool, sqlx::Error> {
    sqlx::query_scalar("SELECT NOT pg_is_in_recovery()")
        .fetch_one(connection)
        .await
}

/// Makes the connection options of one server.
fn options_of(
    url: &PostgresUrl,
    server: &Server,
    password: Option<&str>,
) -> Result<PgConnectOptions, String> {
    // Parsed out of a URL, because only so sqlx looks for the password in `PGPASSFILE`.
    let mut plain = url::Url::parse("postgres://localhost").map_err(|error| error.to_string())?;
    let refused = || "has a user or host that no URL can name".to_owned();
    plain.set_username(&url.user).map_err(|()| refused())?;
    plain.set_path(&url.database);
    let port = match server {
        Server::Tcp { host, port } => {
            plain.set_host(Some(host)).map_err(|_| refused())?;
            *port
        }
        Server::Socket { folder, port } => {
            let folder = folder.to_string_lossy();
            plain.query_pairs_mut().append_pair("host", &folder);
            *port
        }
    };
    plain.set_port(Some(port)).map_err(|()| refused())?;
    let mut options: PgConnectOptions = plain
        .as_str()
        .parse()
        .map_err(|error: sqlx::Error| error.to_string())?;
    options = options
        .application_name("fleetcal")
        .ssl_mode(ssl_mode(url.tls))
        .log_slow_statements(
            tracing::log::LevelFilter::Off,
            limits::POSTGRES_STATEMENT_TIMEOUT,
        );
    if let Some(password) = password {
        options = options.password(password);
    }
    if let Some(path) = &url.root_certificate {
        options = options.ssl_root_cert(path);
    }
    if let Some(path) = &url.client_certificate {
        options = options.ssl_client_cert(path);
    }
    if let Some(path) = &url.client_key {
        options = options.ssl_client_key(path);
    }
    Ok(options)
}

const fn ssl_mode(mode: TlsMode) -> PgSslMode {
    match mode {
        TlsMode::Disable => PgSslMode::Disable,
        TlsMode::Prefer => PgSslMode::Prefer,
        TlsMode::Require => PgSslMode::Require,
        TlsMode::VerifyCa => PgSslMode::VerifyCa,
        TlsMode::VerifyFull => PgSslMode::VerifyFull,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_old_server_and_a_standby_are_told() {
        let old = "is PostgreSQL 14, expected 15 or newer";
        assert_eq!(unsuited(140_013, false).as_deref(), Some(old));
        assert_eq!(unsuited(150_000, false), None);
        let standby = "is a standby, which cannot be written";
        assert_eq!(unsuited(170_002, true).as_deref(), Some(standby));
    }
}
