//! Errors of the store.

use std::path::PathBuf;
use std::sync::Arc;

use fleetcal_domain::access::AccountRefused;
use fleetcal_domain::alert::AlertRefused;
use fleetcal_domain::approval::Refused;
use fleetcal_domain::limits;
use fleetcal_domain::webhook::WebhookRefused;
use fleetcal_model::Version;
use fleetcal_proto::RobotId;
use thiserror::Error;

/// What a database driver said. Shared, because one failed commit is told to many callers.
pub type DriverError = Arc<dyn std::error::Error + Send + Sync>;

/// Why the store could not do what it was asked.
#[derive(Debug, Clone, Error)]
pub enum StoreError {
    /// The folder of the data cannot be made or used.
    #[error("the data folder {path} cannot be used")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        #[source]
        source: Arc<std::io::Error>,
    },
    /// Another process has the folder.
    #[error(
        "the data folder {path} is in use by another fleetcal; stop that one or give another \
         folder with --data"
    )]
    InUse {
        /// The folder.
        path: PathBuf,
    },
    /// The database was written by a newer fleetcal.
    #[error(
        "the database {path} has schema {found}, this fleetcal knows schemas up to {known}; \
         run a newer fleetcal"
    )]
    NewerSchema {
        /// The database file.
        path: PathBuf,
        /// The newest migration in the database.
        found: i64,
        /// The newest migration in this program.
        known: i64,
    },
    /// The server of the database cannot be used.
    #[error("the database {database} {reason}")]
    Server {
        /// Where it is, without a password.
        database: String,
        /// What is wrong with it, a clause.
        reason: String,
    },
    /// The running service keeps the database at another schema.
    #[error(
        "the running service keeps schema {found}, this fleetcal knows {known}; use the fleetcal \
         of the service"
    )]
    OtherSchema {
        /// The newest migration in the database.
        found: i64,
        /// The newest migration in this program.
        known: i64,
    },
    /// There is no database.
    #[error("there is no database at {path}; `fleetcal serve` makes one")]
    Missing {
        /// Where one was looked for.
        path: PathBuf,
    },
    /// A part of the data is not there any more.
    #[error("{} is gone, though {} is there; {remedy}", file.display(), left.display())]
    Gone {
        /// What is not there.
        file: PathBuf,
        /// What shows that it was.
        left: PathBuf,
        /// What to do.
        remedy: &'static str,
    },
    /// A backup could not be written.
    #[error("the backup {path} cannot be written")]
    Backup {
        /// The file.
        path: PathBuf,
        /// What the system said.
        #[source]
        source: Arc<std::io::Error>,
    },
    /// A backup was not restored; nothing was changed.
    #[error("{} {reason}", path.display())]
    Restore {
        /// The file that stands against it.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The database could not be brought to this program's schema.
    #[error("the database could not be brought to the schema of this fleetcal")]
    Migration(#[source] DriverError),
    /// The database failed.
    #[error("the database could not {task}")]
    Database {
        /// What it was doing, an infinitive.
        task: &'static str,
        /// What the driver said.
        #[source]
        source: DriverError,
    },
    /// The database failed while it committed.
    #[error("the database could not commit what was written; it may or may not have kept it")]
    Commit(#[source] DriverError),
    /// Another instance estimates the robot by now.
    #[error("robot {0} is estimated by another instance by now")]
    Fenced(RobotId),
    /// The store ended with rows that could not be written.
    #[error("{rows} rows that were not written yet are lost")]
    RowsLost {
        /// How many.
        rows: u64,
        /// Why they were not written; `None` when the last write did not end in time.
        #[source]
        source: Option<Box<Self>>,
    },
    /// A row holds what this program never writes.
    #[error("the database holds a {table} that cannot be read: {reason}")]
    Corrupt {
        /// The table.
        table: &'static str,
        /// What is wrong with the row.
        reason: String,
    },
    /// The writer has too much waiting.
    #[error("{waiting} writes already wait for the database")]
    QueueFull {
        /// How many wait.
        waiting: usize,
    },
    /// The writer was busy for too long.
    #[error(
        "the database did not take the write within {} s; nothing was changed",
        limits::STORE_ANSWER_WITHIN.as_secs()
    )]
    Late,
    /// The store has been closed.
    #[error("the store is closed")]
    Closed,
    /// The robot's configuration is no longer the one that the caller saw.
    #[error("robot {robot} is at version {found}")]
    VersionConflict {
        /// Whose configuration.
        robot: RobotId,
        /// Its version now; 0 while it has none.
        found: Version,
    },
    /// A user, session or token was not changed.
    #[error(transparent)]
    Account(#[from] AccountRefused),
    /// A decision does not fit the records.
    #[error(transparent)]
    Refused(#[from] Refused),
    /// An acknowledgement does not fit the alert.
    #[error(transparent)]
    Alert(#[from] AlertRefused),
    /// A webhook cannot be made, or is not there.
    #[error(transparent)]
    Webhook(#[from] WebhookRefused),
    /// An `Idempotency-Key` came again with another request.
    #[error("the Idempotency-Key was used before with another request")]
    KeyReused,
}

impl StoreError {
    /// Whether this answers whoever asked, and is no failure of the database.
    pub const fn is_refusal(&self) -> bool {
        matches!(
            self,
            Self::VersionConflict { .. }
                | Self::KeyReused
                | Self::Late
                | Self::Fenced(_)
                | Self::Account(_)
                | Self::Refused(_)
                | Self::Alert(_)
                | Self::Webhook(_)
        )
    }

    /// A driver's error with what was being done, an infinitive.
    pub fn database<E>(task: &'static str) -> impl FnOnce(E) -> Self
    where
        E: std::error::Error + Send + Sync + 'static,
    {
        move |source| Self::Database {
            task,
            source: Arc::new(source),
        }
    }
}
